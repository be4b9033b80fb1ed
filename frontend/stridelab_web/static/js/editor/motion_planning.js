// Starts a job at the press of a button and follows it: what "Plan" and "Find contacts" share.
import { call, followJob, headline, sentence, startJob } from "../shared/api.js";

const viewerOf = (jobId) => `/view/?plan=${encodeURIComponent(jobId)}`;

// Starts the job: whole body and replay, as the main path of the service has it.
export function startPlan(scenarioId, options = {}) {
  return startJob("plan-motion", { scenario_id: scenarioId, whole_body: true, replay: true, ...options });
}

// Why a job did not succeed: how far it came, the sentence, and every place that it names.
function whyNot(job, lastMessage = "") {
  if (job.state === "cancelled") return "Cancelled.";
  const why = job.error ? sentence(job.error.status, job.error) : `The job ended as ${job.state.replaceAll("_", " ")}.`;
  return lastMessage && job.state === "timed_out" ? `${why} It was at: ${lastMessage}.` : why;
}

// To what a job that failed has kept.
function keptLink(job) {
  const link = document.createElement("a");
  link.href = `/plans/${encodeURIComponent(job.id)}`;
  link.textContent = "See how far it comes.";
  return link;
}

// Plans the scenario and opens the plan.
export function offerPlan(root, scenarioId, before) {
  offerJob(root, "plan", {
    start: () => startPlan(scenarioId),
    before,
    onSuccess: (job) => location.assign(viewerOf(job.id)),
  });
}

// Wires `[data-NAME]` (button), `[data-NAME-cancel]` (button), `[data-NAME-live]` (shown while the job runs, with a
// <progress> and `[data-NAME-message]`) and `[data-NAME-said]` (problems) inside `root`. What `onSuccess` does with a job that
// succeeded leads away.
export function offerJob(root, name, { start, before, onSuccess }) {
  const part = (ending) => root.querySelector(`[data-${name}${ending}]`);
  const [button, cancel, live, message, said] = ["", "-cancel", "-live", "-message", "-said"].map(part);
  const bar = live.querySelector("progress");
  /** @type {any} */
  let job = null;

  button.addEventListener("click", async () => {
    button.disabled = true;
    said.textContent = "";
    try {
      await before();
      job = await start();
      show(job);
      live.hidden = cancel.disabled = false;
      let last = "";
      const ended = await followJob(job.id, (now) => {
        last = now.progress.message || last;
        show(now);
      });
      if (ended.state === "succeeded") return void (await onSuccess(ended));
      said.textContent = whyNot(ended, last);
      if (ended.has_result) said.append(" ", keptLink(ended));
    } catch (error) {
      said.textContent = error.message;
    }
    live.hidden = true;
    button.disabled = false;
  });

  cancel.addEventListener("click", async () => {
    cancel.disabled = true;
    message.textContent = "cancelling…";
    await call("DELETE", `/jobs/${job.id}?cancel_only=true`).catch((error) => {
      said.textContent = error.message;
      cancel.disabled = false;
    });
  });

  function show(now) {
    bar.value = now.progress.fraction;
    message.textContent = headline(now) || now.state;
  }
}
