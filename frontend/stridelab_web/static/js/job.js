// One job, live: server-sent events, which the browser resumes by itself after a lost connection.
import { FINAL, call, headline, showState } from "./api.js";

const card = document.querySelector("[data-live]");
const cancel = document.querySelector("[data-cancel]");
const id = card.dataset.live;

if (card.dataset.final !== "true") follow();

function follow() {
  const source = new EventSource(`/api/v1/jobs/${id}/events`);
  const seen = (event) => {
    const job = JSON.parse(event.data);
    show(job);
    if (FINAL.has(job.state)) {
      source.close();
      finish(job);
    }
  };
  for (const name of ["message", "progress", "state"]) source.addEventListener(name, seen);
  // A closed stream (not a lost one) is not reopened by the browser: ask once how things stand.
  source.addEventListener("error", async () => {
    if (source.readyState !== EventSource.CLOSED) return;
    const job = await call("GET", `/jobs/${id}?wait=20`).catch(() => null);
    if (job && FINAL.has(job.state)) finish(job);
    else setTimeout(follow, 1000);
  });
}

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
    await call("DELETE", `/jobs/${id}`);
    card.querySelector("[data-message]").textContent = "cancelling…";
  } catch (error) {
    card.querySelector("[data-message]").textContent = error.message;
    cancel.disabled = false;
  }
});
