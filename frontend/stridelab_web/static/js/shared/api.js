// Requests to /api/v1; every failure becomes an error with a sentence.
import { checkConnection, isLoggedOut, onRestored } from "./connection_notice.js";
import { setActive } from "./focus.js";
import { Silence } from "./silence.js";
import { translate, translateServed } from "./translate.js";

const LATE_MS = 5000; // an answer that takes longer may not come
const UNAUTHENTICATED = 401;

class ApiError extends Error {
  /** @param {number} status @param {ApiProblem | null} problem @param {string | null} retryAfter */
  constructor(status, problem, retryAfter = null) {
    super(problemSentence(status, problem, retryAfter));
    this.status = status;
    this.problem = problem;
  }
}

// Whether `call` failed because the service did not answer or the login has ended, of which the page's notice says enough.
/** @param {unknown} error @returns {error is ApiError} */
export const isUnanswered = (error) =>
  error instanceof ApiError && (error.status === 0 || error.status === UNAUTHENTICATED);

/** @param {number} status @param {ApiProblem | null} problem @param {string | null} retryAfter */
export function problemSentence(status, problem, retryAfter = null) {
  if (status === UNAUTHENTICATED) return translate("Not done: log in again, then repeat it."); // the notice says why
  if (!problem)
    return status === 0
      ? translate("The service does not answer. Is it still running?")
      : translate("The service answered %(status)s.", { status });
  const places = faultsNotInDetail(problem).map(({ where, message }) =>
    message ? `${where}: ${translateServed(message)}` : where,
  );
  const retry =
    Number(retryAfter) > 0 ? [translate("Try again in %(seconds)s s.", { seconds: Number(retryAfter) })] : [];
  return [translateServed(problem.detail || problem.title), ...places, ...retry].join(" ");
}

// The faults of a problem without those that its detail already contains, so that each is shown once.
/** @param {ApiProblem} problem @returns {{ where: string, message: string }[]} */
function faultsNotInDetail(problem) {
  const detail = (problem.detail || problem.title).toLowerCase();
  return (problem.errors || []).flatMap(({ where, message }) => {
    const isNew = !detail.includes(message.toLowerCase());
    const place = where.slice(where.lastIndexOf(": ") + 1).trim();
    return isNew || !detail.includes(place.toLowerCase()) ? [{ where, message: isNew ? message : "" }] : [];
  });
}

// Starts a job. The idempotency key lets the browser repeat the request without a second job.
/** @param {string} kind @param {object} input @returns {Promise<any>} */
export function startJob(kind, input) {
  return call("POST", `/jobs/${kind}`, input, { "Idempotency-Key": uniqueKey() });
}

// Starts a job and opens its page.
/** @param {string} kind @param {object} input @param {string} page the address before the id of the job */
export async function openNewJob(kind, input, page = "/jobs") {
  location.assign(`${page}/${(await startJob(kind, input)).id}`);
  return translate("Started.");
}

/**
 * @param {string} method
 * @param {string} path
 * @param {object} [body] a form, or what is sent as JSON
 * @param {Record<string, string>} headers
 * @returns {Promise<any>} the JSON of the response
 */
export async function call(method, path, body, headers = {}) {
  /** @type {RequestInit & { headers: Record<string, string> }} */
  const options = { method, headers: { Accept: "application/json", ...headers } };
  if (body instanceof FormData) options.body = body;
  else if (body !== undefined) {
    options.headers["Content-Type"] = "application/json";
    options.body = JSON.stringify(body);
  }
  let response, text;
  const late = setTimeout(checkConnection, LATE_MS);
  try {
    response = await fetch(`/api/v1${path}`, options);
    text = await response.text();
  } catch {
    checkConnection();
    throw new ApiError(0, null);
  } finally {
    clearTimeout(late);
  }
  if (response.status === UNAUTHENTICATED) checkConnection();
  let value = null;
  try {
    value = text ? JSON.parse(text) : null;
  } catch {
    throw new ApiError(response.status, null);
  }
  if (!response.ok) throw new ApiError(response.status, value, response.headers.get("Retry-After"));
  return value;
}

// A successful response of a page's own address. Throws the sentence of the service, of its error page, or `otherwise`.
/** @param {string} url @param {RequestInit} [options] @param {string} [otherwise] */
export async function fetchChecked(url, options, otherwise = translate("The scene could not be read.")) {
  const response = await fetch(url, options).catch(() => null);
  if (response?.ok) return response;
  if (!response || response.status === UNAUTHENTICATED) {
    checkConnection();
    throw new Error(problemSentence(response?.status ?? 0, null));
  }
  const text = await response.text().catch(() => "");
  if (response.headers.get("Content-Type")?.startsWith("text/html")) {
    const page = new DOMParser().parseFromString(text, "text/html");
    throw new Error(page.querySelector("[data-detail]")?.textContent || otherwise);
  }
  const { detail } = parsedJson(text) ?? {};
  throw new Error(detail ? translateServed(detail) : otherwise);
}

// The JSON of a response to an XMLHttpRequest; null where a proxy answered with a page instead.
/** @param {XMLHttpRequest} request */
export const responseJson = (request) => parsedJson(request.responseText);

/** @param {string} text */
function parsedJson(text) {
  try {
    return JSON.parse(text);
  } catch {
    return null;
  }
}

function uniqueKey() {
  const words = crypto.getRandomValues(new Uint32Array(4));
  return Array.from(words, (word) => word.toString(16).padStart(8, "0")).join("");
}

export const FINAL_STATES = new Set(["succeeded", "failed", "cancelled", "timed_out"]);

/** @param {Job} job */
export function jobHeadline(job) {
  if (job.state === "queued")
    return job.queue_position == null
      ? translate("waiting")
      : translate("place %(place)s in the queue", { place: job.queue_position });
  if (job.error?.detail) return translateServed(job.error.detail);
  return FINAL_STATES.has(job.state) ? "" : translateServed(job.progress.text || job.progress.message);
}

/** @param {HTMLElement} node @param {Job} job */
export function showJobState(node, job) {
  node.className = `state state-${job.state}${job.verdict ? ` judged-${job.verdict.outcome}` : ""}`;
  node.textContent = translate(job.state.replaceAll("_", " "));
}

// Shows the verdict on the result of a job; most kinds of jobs have none.
/** @param {HTMLElement} node @param {Job} job */
export function showJobOutcome(node, job) {
  node.hidden = !job.verdict;
  node.className = `outcome${job.verdict ? ` outcome-${job.verdict.outcome}` : ""}`;
  node.textContent = translateServed(job.verdict?.message ?? "");
}

// Runs `action` on submit with the button inactive, and shows its result or its error beside the button.
/** @param {PageElement} form @param {(data: FormData) => string | Promise<string>} action */
export function onSubmit(form, action) {
  form.addEventListener("submit", async (event) => {
    event.preventDefault();
    const status = form.querySelector("[data-said]");
    const button = form.querySelector("button:not([type=button])");
    setActive(button, false);
    status.textContent = "…";
    try {
      status.textContent = (await action(new FormData(/** @type {any} */ (form)))) || "";
    } catch (error) {
      status.textContent = /** @type {Error} */ (error).message;
    } finally {
      setActive(button, true);
    }
  });
}

// Runs `action` at each click with the button inactive, which it stays if the page is left; shows an error in `status`.
/** @param {any} button @param {PageElement} status @param {() => unknown} action */
export function onClick(button, status, action) {
  button?.addEventListener("click", async () => {
    setActive(button, false);
    try {
      await action();
    } catch (error) {
      status.textContent = /** @type {Error} */ (error).message;
      setActive(button, true);
    }
  });
}

// Opens the page's dialog from the button `data-delete`; on confirmation, deletes `path` and opens `next`.
/** @param {string} path @param {string} next */
export function confirmDeletion(path, next) {
  const dialog = /** @type {any} */ (document.querySelector("[data-confirm]"));
  document.querySelector("[data-delete]")?.addEventListener("click", () => dialog.showModal());
  dialog?.querySelector("[data-no]").addEventListener("click", () => dialog.close());
  onClick(dialog?.querySelector("[data-yes]"), dialog?.querySelector("[data-said]"), async () => {
    await call("DELETE", path);
    location.assign(next);
  });
}

const RETRY_MS = 1000,
  LOGGED_OUT_MS = 20_000,
  QUIET_MS = 15_000; // a job may have nothing new for long

// Calls `onChange(job)` for every state of a job; resolves with the finished job, its error included. The browser resumes
// a lost event stream; a closed one is opened again, and so is one of a network that carried nothing for a while.
/**
 * @param {string} id
 * @param {(job: Job) => void} onChange
 * @returns {Promise<any>}
 */
export function followJob(id, onChange) {
  return new Promise((resolve) => {
    let isFinished = false,
      last = 0; // number of the newest event
    /** @type {EventSource} */
    let current;
    const silence = new Silence(QUIET_MS, checkConnection);
    const finish = async (/** @type {Job} */ job) => {
      if (isFinished) return;
      isFinished = true;
      silence.stop();
      current.close();
      resolve(await call("GET", `/jobs/${id}`).catch(() => job));
    };
    const connect = () => {
      const source = new EventSource(`/api/v1/jobs/${id}/events`);
      current = source;
      const onEvent = (/** @type {MessageEvent} */ event) => {
        silence.interrupt();
        if (Number(event.lastEventId) < last) return; // sent again; a final state may have the number of the event before
        last = Number(event.lastEventId);
        const job = JSON.parse(event.data);
        onChange(job);
        if (!FINAL_STATES.has(job.state)) return;
        source.close();
        finish(job);
      };
      for (const name of ["message", "progress", "state"]) source.addEventListener(name, onEvent);
      source.addEventListener("error", async () => {
        checkConnection();
        if (source.readyState !== EventSource.CLOSED || isFinished || source !== current) return;
        const job = await call("GET", `/jobs/${id}?wait=20`).catch(() => null);
        if (job && FINAL_STATES.has(job.state)) finish(job);
        else setTimeout(connect, isLoggedOut() ? LOGGED_OUT_MS : RETRY_MS);
      });
    };
    connect();
    onRestored(() => {
      if (isFinished) return;
      current.close();
      connect();
    });
  });
}
