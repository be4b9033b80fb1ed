// Rows of job tables follow their jobs; only rows that can still change are asked for.
import { FINAL, call, headline, showOutcome, showState } from "../shared/api.js";

const EVERY_MS = 1000;
const rows = [...document.querySelectorAll("tr[data-job]")];

for (const row of rows) {
  const cancel = row.querySelector("[data-cancel]");
  cancel.addEventListener("click", async () => {
    cancel.disabled = true;
    try {
      await call("DELETE", `/jobs/${row.dataset.job}?cancel_only=true`);
      await refresh(row);
    } catch (error) {
      row.querySelector("[data-message]").textContent = error.message;
    }
  });
}

async function refresh(row) {
  const job = await call("GET", `/jobs/${row.dataset.job}`);
  const state = row.querySelector("[data-state]");
  if (!state.classList.contains(`state-${job.state}`)) showState(state, job);
  const bar = row.querySelector("progress");
  bar.value = job.progress.fraction;
  bar.hidden = FINAL.has(job.state);
  row.querySelector("[data-message]").textContent = headline(job);
  showOutcome(row.querySelector("[data-outcome]"), job);
  row.dataset.final = FINAL.has(job.state);
  row.querySelector("[data-cancel]").hidden = FINAL.has(job.state);
}

async function round() {
  const open = rows.filter((row) => row.dataset.final !== "true");
  if (!document.hidden) await Promise.allSettled(open.map(refresh));
  if (open.length) setTimeout(round, EVERY_MS);
}
round();
