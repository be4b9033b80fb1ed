// Updates the rows of job tables by polling the jobs that are not finished.
import { FINAL_STATES, call, jobHeadline, onClick, showJobOutcome, showJobState } from "../shared/api.js";
import { isNoticeWanted, notifyOfEnd } from "../shared/job_notice.js";

const POLL_MS = 1000;
const rows = [...document.querySelectorAll("tr[data-job]")];

for (const row of rows) {
  const cancel = row.querySelector("[data-cancel]");
  onClick(cancel, row.querySelector("[data-message]"), async () => {
    await call("DELETE", `/jobs/${row.dataset.job}?cancel_only=true`);
    await refreshRow(row);
  });
}

/** @param {PageElement} row */
async function refreshRow(row) {
  const job = await call("GET", `/jobs/${row.dataset.job}`);
  const state = row.querySelector("[data-state]");
  if (!state.classList.contains(`state-${job.state}`)) showJobState(state, job);
  const bar = row.querySelector("progress");
  bar.value = job.progress.fraction;
  bar.hidden = FINAL_STATES.has(job.state);
  row.querySelector("[data-message]").textContent = jobHeadline(job);
  showJobOutcome(row.querySelector("[data-outcome]"), job);
  row.dataset.final = String(FINAL_STATES.has(job.state));
  if (FINAL_STATES.has(job.state)) notifyOfEnd(job, row.querySelector("td").textContent.replace(/\s+/g, " ").trim());
  row.querySelector("[data-cancel]").hidden = FINAL_STATES.has(job.state);
}

async function pollOpenJobs() {
  const open = rows.filter((row) => row.dataset.final !== "true");
  if (!document.hidden || isNoticeWanted()) await Promise.allSettled(open.map(refreshRow));
  if (open.length) setTimeout(pollOpenJobs, POLL_MS);
}
pollOpenJobs();
