// The only place that talks to /api/v1. Every failure becomes a sentence.
import { doubt } from "./connection_notice.js";

class ApiError extends Error {
  constructor(status, problem, retryAfter = null) {
    super(sentence(status, problem, retryAfter));
    this.status = status;
    this.problem = problem;
  }
}

export function sentence(status, problem, retryAfter = null) {
  if (!problem)
    return status === 0 ? "The service does not answer. Is it still running?" : `The service answered ${status}.`;
  const places = (problem.errors || []).map((item) => `${item.where}: ${item.message}`);
  const wait = Number(retryAfter) > 0 ? [`Try again in ${Number(retryAfter)} s.`] : [];
  return [problem.detail || problem.title, ...places, ...wait].join(" ");
}

// One answer per press of a button: a lost answer can be asked for again without a second job.
/** @returns {Promise<any>} */
export function startJob(kind, input) {
  return call("POST", `/jobs/${kind}`, input, { "Idempotency-Key": uniqueKey() });
}

/** @returns {Promise<any>} */
export async function call(method, path, body, headers = {}) {
  const options = { method, headers: { Accept: "application/json", ...headers } };
  if (body instanceof FormData) options.body = body;
  else if (body !== undefined) {
    options.headers["Content-Type"] = "application/json";
    options.body = JSON.stringify(body);
  }
  let answer;
  try {
    answer = await fetch(`/api/v1${path}`, options);
  } catch {
    doubt();
    throw new ApiError(0, null);
  }
  if (answer.status === 401) location.assign(`/login?next=${encodeURIComponent(location.pathname + location.search)}`);
  const text = await answer.text();
  let value = null;
  try {
    value = text ? JSON.parse(text) : null;
  } catch {
    throw new ApiError(answer.status, null);
  }
  if (!answer.ok) throw new ApiError(answer.status, value, answer.headers.get("Retry-After"));
  return value;
}

// What an XMLHttpRequest was answered; null where a proxy answered with a page instead: the status says enough then.
export function answerOf(request) {
  try {
    return JSON.parse(request.responseText);
  } catch {
    return null;
  }
}

function uniqueKey() {
  const words = crypto.getRandomValues(new Uint32Array(4));
  return Array.from(words, (word) => word.toString(16).padStart(8, "0")).join("");
}

export const FINAL = new Set(["succeeded", "failed", "cancelled", "timed_out"]);

export function headline(job) {
  if (job.state === "queued")
    return job.queue_position == null ? "waiting" : `place ${job.queue_position} in the queue`;
  if (job.error?.detail) return job.error.detail;
  return FINAL.has(job.state) ? "" : job.progress.message;
}

export function showState(node, job) {
  node.className = `state state-${job.state}${job.verdict ? ` judged-${job.verdict.outcome}` : ""}`;
  node.textContent = job.state.replaceAll("_", " ");
}

// The verdict on the result of a job that succeeded; most kinds of jobs have none.
export function showOutcome(node, job) {
  node.hidden = !job.verdict;
  node.className = `outcome${job.verdict ? ` outcome-${job.verdict.outcome}` : ""}`;
  node.textContent = job.verdict?.message ?? "";
}

// Runs `work` on submit with the button disabled; what it returns, or the failure, is said beside the button.
export function onSubmit(form, work) {
  form.addEventListener("submit", async (event) => {
    event.preventDefault();
    const said = form.querySelector("[data-said]");
    const button = form.querySelector("button:not([type=button])");
    button.disabled = true;
    said.textContent = "…";
    try {
      said.textContent = (await work(new FormData(form))) || "";
    } catch (error) {
      said.textContent = error.message;
    } finally {
      button.disabled = false;
    }
  });
}

const ASK_AGAIN_MS = 1000;

// Tells `seen(job)` every state of a job; resolves with the finished job, its error included. A stream that was lost
// is taken up by the browser, one that was closed is opened anew.
/**
 * @param {string} id
 * @param {(job: any) => void} seen
 * @returns {Promise<any>}
 */
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
        doubt();
        if (source.readyState !== EventSource.CLOSED || over) return;
        const job = await call("GET", `/jobs/${id}?wait=20`).catch(() => null);
        if (job && FINAL.has(job.state)) finish(job);
        else setTimeout(listen, ASK_AGAIN_MS);
      });
    };
    listen();
  });
}
