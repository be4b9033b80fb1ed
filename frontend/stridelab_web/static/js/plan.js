// Plans a scenario's motion and follows the job: pages that offer "Plan" share this.
import { ApiError, FINAL, call, headline, sentence, startJob } from "./api.js";

const ASK_AGAIN_MS = 1000;

export const viewerOf = (jobId) => `/view/?plan=${encodeURIComponent(jobId)}`;

// Starts the job: whole body and replay, as the main path of the service has it.
export function startPlan(scenarioId, options = {}) {
  return startJob("plan-motion", { scenario_id: scenarioId, whole_body: true, replay: true, ...options });
}

// Tells `seen(job)` every state of a job; resolves with the finished job, its error included. A stream that was lost
// is taken up by the browser, one that was closed is opened anew.
export function followJob(id, seen = () => {}) {
  return new Promise((done) => {
    let over = false;
    const finish = async (job) => {
      if (over) return;
      over = true;
      done(await call("GET", `/jobs/${id}`).catch(() => job));
    };
    const listen = () => {
      const source = new EventSource(`/api/v1/jobs/${id}/events`);
      const onEvent = (event) => {
        const job = JSON.parse(event.data);
        seen(job);
        if (!FINAL.has(job.state)) return;
        source.close();
        finish(job);
      };
      for (const name of ["message", "progress", "state"]) source.addEventListener(name, onEvent);
      source.addEventListener("error", async () => {
        if (source.readyState !== EventSource.CLOSED || over) return;
        const job = await call("GET", `/jobs/${id}?wait=20`).catch(() => null);
        if (job && FINAL.has(job.state)) finish(job);
        else setTimeout(listen, ASK_AGAIN_MS);
      });
    };
    listen();
  });
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
