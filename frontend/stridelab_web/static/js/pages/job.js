// One job, live: server-sent events, which the browser resumes by itself after a lost connection.
import { call, followJob, headline, showState } from "../shared/api.js";
import { FOUND, TIMED, bodyOf, openNew } from "../editor/scenario_requests.js";

const card = document.querySelector("[data-live]");
const cancel = document.querySelector("[data-cancel]");
const id = card.dataset.live;

if (card.dataset.final !== "true") followJob(id, show).then(finish);

// A page that was opened to see the result goes on to it; a failure stays here, with its reason.
function finish(job) {
  if (job.state === "succeeded" && card.dataset.then) location.replace(card.dataset.then);
  else location.reload();
}

function show(job) {
  const state = card.querySelector("[data-state]");
  if (!state.classList.contains(`state-${job.state}`)) showState(state, job);
  card.querySelector("[data-message]").textContent = headline(job);
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

// The contacts that were found, or the durations that were chosen, become a scenario of one's own, in the editor.
const keepButton = document.querySelector("[data-keep]");
keepButton?.addEventListener("click", async () => {
  keepButton.disabled = true;
  try {
    const found = (await call("GET", `/jobs/${id}/result`)).summary.scenario;
    if (found) await openNew(found, FOUND);
    else await openNew(bodyOf(await call("GET", `/jobs/${id}/artifacts/scenario.json`)), TIMED);
  } catch (error) {
    document.querySelector("[data-said-keep]").textContent = error.message;
    keepButton.disabled = false;
  }
});
