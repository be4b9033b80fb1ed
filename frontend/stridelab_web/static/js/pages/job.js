// The page of one job: follows its progress, cancels and deletes it, and stores its result as a scenario.
import { call, confirmDeletion, followJob, jobHeadline, onClick, openNewJob, showJobState } from "../shared/api.js";
import { CONTACTS_SUFFIX, DURATIONS_SUFFIX, scenarioFields, openAsNewScenario } from "../editor/scenario_store.js";
import { notifyOfEnd } from "../shared/job_notice.js";
import { translate } from "../shared/translate.js";

const card = document.querySelector("[data-live]");
const cancel = document.querySelector("[data-cancel]");
const id = card.dataset.live;

if (card.dataset.final !== "true") followJob(id, showProgress).then(finish);

// Opens the result if the page was opened for it; a failed job stays here, with its reason.
/** @param {Job} job */
function finish(job) {
  notifyOfEnd(job);
  if (job.state === "succeeded" && card.dataset.then) location.replace(card.dataset.then);
  else location.reload();
}

/** @param {Job} job */
function showProgress(job) {
  const state = card.querySelector("[data-state]");
  if (!state.classList.contains(`state-${job.state}`)) showJobState(state, job);
  card.querySelector("[data-message]").textContent = jobHeadline(job);
  card.querySelector("progress").value = job.progress.fraction;
}

const message = card.querySelector("[data-message]");
onClick(cancel, message, async () => {
  await call("DELETE", `/jobs/${id}?cancel_only=true`);
  message.textContent = translate("cancelling…");
});
confirmDeletion(`/jobs/${id}`, "/jobs");

const compare = document.querySelector("[data-compare-methods]");
onClick(compare, document.querySelector("[data-said-compare]"), () =>
  openNewJob("compare-estimators", { recording_id: compare.dataset.compareMethods }),
);

// Stores the planned contacts or the optimised durations as a new scenario and opens it in the editor.
onClick(document.querySelector("[data-keep]"), document.querySelector("[data-said-keep]"), async () => {
  /** @type {Api.JobResult} */
  const result = await call("GET", `/jobs/${id}/result`);
  const { scenario } = result.summary;
  if (scenario) return openAsNewScenario(scenario, CONTACTS_SUFFIX);
  const planned = scenarioFields(await call("GET", `/jobs/${id}/artifacts/scenario.json`));
  return openAsNewScenario(planned, DURATIONS_SUFFIX);
});
