// The page of one job: follows its progress, cancels and deletes it, and stores its result as a scenario.
import { call, followJob, jobHeadline, showJobState } from "../shared/api.js";
import { CONTACTS_SUFFIX, DURATIONS_SUFFIX, scenarioFields, openAsNewScenario } from "../editor/scenario_store.js";

const card = document.querySelector("[data-live]");
const cancel = document.querySelector("[data-cancel]");
const id = card.dataset.live;

if (card.dataset.final !== "true") followJob(id, showProgress).then(finish);

// Opens the result if the page was opened for it; a failed job stays here, with its reason.
function finish(job) {
  if (job.state === "succeeded" && card.dataset.then) location.replace(card.dataset.then);
  else location.reload();
}

function showProgress(job) {
  const state = card.querySelector("[data-state]");
  if (!state.classList.contains(`state-${job.state}`)) showJobState(state, job);
  card.querySelector("[data-message]").textContent = jobHeadline(job);
  card.querySelector("progress").value = job.progress.fraction;
}

cancel?.addEventListener("click", async () => {
  cancel.disabled = true;
  try {
    await call("DELETE", `/jobs/${id}?cancel_only=true`);
    card.querySelector("[data-message]").textContent = "cancelling…";
  } catch (error) {
    card.querySelector("[data-message]").textContent = error.message;
    cancel.disabled = false;
  }
});

const dialog = document.querySelector("[data-confirm]");
document.querySelector("[data-delete]")?.addEventListener("click", () => dialog.showModal());
dialog?.querySelector("[data-no]").addEventListener("click", () => dialog.close());
dialog?.querySelector("[data-yes]").addEventListener("click", async () => {
  try {
    await call("DELETE", `/jobs/${id}`);
    location.assign("/jobs");
  } catch (error) {
    dialog.querySelector("[data-said]").textContent = error.message;
  }
});

// Stores the planned contacts or the optimised durations as a new scenario and opens it in the editor.
const keepButton = document.querySelector("[data-keep]");
keepButton?.addEventListener("click", async () => {
  keepButton.disabled = true;
  try {
    const scenario = (await call("GET", `/jobs/${id}/result`)).summary.scenario;
    if (scenario) await openAsNewScenario(scenario, CONTACTS_SUFFIX);
    else
      await openAsNewScenario(
        scenarioFields(await call("GET", `/jobs/${id}/artifacts/scenario.json`)),
        DURATIONS_SUFFIX,
      );
  } catch (error) {
    document.querySelector("[data-said-keep]").textContent = error.message;
    keepButton.disabled = false;
  }
});
