// Plans a scenario's motion and follows the job: pages that offer "Plan" share this.
import { ApiError, call, followJob, headline, sentence, startJob } from "./api.js";

export const viewerOf = (jobId) => `/view/?plan=${encodeURIComponent(jobId)}`;

// Starts the job: whole body and replay, as the main path of the service has it.
export function startPlan(scenarioId, options = {}) {
  return startJob("plan-motion", { scenario_id: scenarioId, whole_body: true, replay: true, ...options });
}

// Why a job did not succeed: how far it came, the sentence, and every place that it names.
export function whyNot(job, lastMessage = "") {
  if (job.state === "cancelled") return "Cancelled.";
  const why = job.error ? sentence(job.error.status, job.error) : `The job ended as ${job.state.replaceAll("_", " ")}.`;
  return lastMessage && job.state === "timed_out" ? `${why} It was at: ${lastMessage}.` : why;
}

// Wires `[data-plan]` (button), `[data-plan-cancel]` (button), `[data-plan-live]` (shown while the job runs, with a
// <progress> and `[data-plan-message]`) and `[data-plan-said]` (problems) inside `root`.
export function offerPlan(root, scenarioId, { before = async () => {}, then = (job) => location.assign(viewerOf(job.id)) } = {}) {
  const part = (name) => root.querySelector(`[data-plan${name}]`);
  const [button, cancel, live, message, said] = ["", "-cancel", "-live", "-message", "-said"].map(part);
  const bar = live.querySelector("progress");
  let job = null;

  button.addEventListener("click", async () => {
    button.disabled = true;
    said.textContent = "";
    try {
      await before();
      job = await startPlan(scenarioId);
      show(job);
      live.hidden = cancel.disabled = false;
      let last = "";
      const ended = await followJob(job.id, (now) => {
        last = now.progress.message || last;
        show(now);
      });
      if (ended.state === "succeeded") return void then(ended);
      said.textContent = whyNot(ended, last);
    } catch (error) {
      said.textContent = error instanceof ApiError ? error.message : String(error);
    }
    live.hidden = true;
    button.disabled = false;
  });

  cancel.addEventListener("click", async () => {
    cancel.disabled = true;
    message.textContent = "cancelling…";
    await call("DELETE", `/jobs/${job.id}`).catch((error) => {
      said.textContent = error.message;
      cancel.disabled = false;
    });
  });

  function show(now) {
    bar.value = now.progress.fraction;
    message.textContent = headline(now) || now.state;
  }
}
