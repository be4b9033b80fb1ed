// Buttons that start a planning job, follow it and open its result: those of the editor and of new scenarios.
import { call, followJob, jobHeadline, problemSentence, startJob } from "../shared/api.js";
import { createElement, writeToAddress } from "../shared/elements.js";
import { setActive } from "../shared/focus.js";
import { notifyOfEnd } from "../shared/job_notice.js";
import { translate, translateServed } from "../shared/translate.js";
import { CONTACTS_SUFFIX, openAsNewScenario } from "./scenario_store.js";

const FEET = ["left_foot", "right_foot"];
const planViewerUrl = (/** @type {string} */ jobId) => `/view/?plan=${encodeURIComponent(jobId)}&play=1`;
const PLANNING = "planning"; // the job that the editor follows, in its address
// The editor of a scenario that shows its plan while it is computed, and then opens it.
export const planningUrl = (/** @type {string} */ scenarioId, /** @type {string} */ jobId) =>
  `/view/?scenario=${encodeURIComponent(scenarioId)}&${PLANNING}=${encodeURIComponent(jobId)}`;

// Starts a plan with whole body and replay, the defaults of the service.
/** @param {string} scenarioId */
export function startPlan(scenarioId, options = {}) {
  return startJob("plan-motion", { scenario_id: scenarioId, whole_body: true, replay: true, ...options });
}

// The reason why a job did not succeed, with the last progress message of one that ran out of time.
/** @param {any} job */
function failureReason(job, lastMessage = "") {
  if (job.state === "cancelled") return translate("Cancelled.");
  const reason = job.error
    ? problemSentence(job.error.status, job.error)
    : translate("The job ended as %(state)s.", { state: translate(job.state.replaceAll("_", " ")) });
  if (!lastMessage || job.state !== "timed_out") return reason;
  const last = translate("It was at: %(message)s.", { message: translateServed(lastMessage) });
  return `${reason} ${last}`;
}

// A link to the partial result of a failed job.
const partialResultLink = (/** @type {any} */ job) =>
  createElement("a", { href: `/plans/${encodeURIComponent(job.id)}` }, translate("See how far it comes."));

// Plans the scenario and opens the plan; `onRun()` is called when a plan begins, `onJob(id)` when its job is known,
// `onProgress()` at each of its events, `onSuccess()` is awaited before the page is left, and `onEnd()` is called when it has ended
// without success.
// Returns a function that follows the job of the address, if there is one.
/**
 * @param {PageElement} root
 * @param {string} scenarioId
 * @param {{ before: () => unknown, onRun: () => void, onJob: (jobId: string) => void, onProgress: () => void, onSuccess: () => Promise<void>, onEnd: () => void }} options
 */
export function bindPlanButton(root, scenarioId, { before, onRun, onJob, onProgress, onSuccess, onEnd }) {
  const follow = bindJobButton(root, "plan", {
    start: async () => {
      onRun();
      const job = await startPlan(scenarioId);
      writeToAddress(PLANNING, job.id);
      return job;
    },
    before,
    onSuccess: async (job) => {
      await onSuccess();
      writeToAddress(PLANNING, null); // a step back in the history leads to the editor
      location.assign(planViewerUrl(job.id));
    },
    onJob,
    onProgress,
    onEnd: () => {
      writeToAddress(PLANNING, null);
      onEnd();
    },
  });
  return () => {
    const jobId = new URLSearchParams(location.search).get(PLANNING);
    if (!jobId) return;
    onRun();
    follow(jobId);
  };
}

// Plans contacts from the stance of the first phase to that of the last, and opens them as a new scenario.
/** @param {PageElement} root @param {string} scenarioId @param {() => unknown} before */
export function bindContactsButton(root, scenarioId, before) {
  let name = "";
  const start = async () => {
    const stored = await call("GET", `/scenarios/${scenarioId}`);
    name = stored.name;
    return startJob("plan-contacts", contactTask(stored));
  };
  const onSuccess = async (/** @type {any} */ job) => {
    const result = await call("GET", `/jobs/${job.id}/result`);
    await openAsNewScenario({ ...result.summary.scenario, name }, CONTACTS_SUFFIX);
  };
  bindJobButton(root, "find", { start, before, onSuccess });
}

// Plans the contacts of a task and stores them; `onStored(scenario)` leaves the page.
/**
 * @param {PageElement} root
 * @param {string} name
 * @param {() => Promise<object>} task
 * @param {(scenario: any) => unknown} onStored
 */
export function bindTaskButton(root, name, task, onStored) {
  const start = async () => startJob("plan-contacts", await task());
  const onSuccess = async (/** @type {any} */ job) => {
    const result = await call("GET", `/jobs/${job.id}/result`);
    await onStored(await call("POST", "/scenarios", result.summary.scenario));
  };
  bindJobButton(root, name, { start, before: () => {}, onSuccess });
}

/** @param {{ name: string, robot: string, terrain: Surface[], friction: number, phases: Phase[] }} options */
function contactTask({ name, robot, terrain, friction, phases }) {
  if (!phases.length) throw new Error("This scenario has no phases: there is no start and no goal.");
  const stances = { start: phases[0], goal: phases[phases.length - 1] };
  for (const [end, { contacts }] of Object.entries(stances)) {
    const missing = FEET.filter(
      (foot) => !contacts.some((/** @type {Contact} */ contact) => contact.effector === foot),
    );
    const phase = end === "start" ? "first" : "last";
    if (missing.length)
      throw new Error(
        `A ${end} needs both feet, and the ${phase} phase lacks the ${missing.map((foot) => foot.replace("_", " ")).join(" and the ")}.`,
      );
  }
  const [start, goal] = Object.values(stances).map(({ contacts }) => ({ contacts }));
  return { name, robot, terrain, friction, start, goal };
}

// Binds `[data-NAME]` (button), `[data-NAME-cancel]` (button), `[data-NAME-live]` (shown while the job runs, with a
// <progress> and `[data-NAME-message]`) and `[data-NAME-said]` (problems) inside `root`. `before` is awaited before `start`;
// `onJob(id)` and `onProgress()` as for plans; `onSuccess(job)` leaves the page; `onEnd()` is called after any other end. Returns a function that follows a running job.
/**
 * @param {PageElement} root
 * @param {string} name
 * @param {{ start: () => any, before: () => unknown, onSuccess: (job: any) => unknown, onJob?: (jobId: string) => void, onProgress?: () => void, onEnd?: () => void }} options
 */
function bindJobButton(
  root,
  name,
  { start, before, onSuccess, onJob = (/** @type {string} */ _id) => {}, onProgress = () => {}, onEnd = () => {} },
) {
  const part = (/** @type {string} */ ending) => root.querySelector(`[data-${name}${ending}]`);
  const [button, cancel, live, message, problem] = ["", "-cancel", "-live", "-message", "-said"].map(part);
  const bar = live.querySelector("progress");
  /** @type {any} */
  let job = null;

  button.addEventListener("click", () =>
    run(async () => {
      await before();
      return start();
    }),
  );

  /** @param {() => Promise<any>} begin */
  async function run(begin) {
    setActive(button, false);
    problem.textContent = "";
    try {
      job = await begin();
      onJob(job.id);
      show(job);
      live.hidden = false;
      setActive(cancel, true);
      let lastMessage = "";
      const finished = await followJob(job.id, (current) => {
        lastMessage = current.progress.text || current.progress.message || lastMessage;
        show(current);
        onProgress();
      });
      notifyOfEnd(finished);
      if (finished.state === "succeeded") return void (await onSuccess(finished));
      problem.textContent = failureReason(finished, lastMessage);
      if (finished.has_result) problem.append(" ", partialResultLink(finished));
    } catch (error) {
      problem.textContent = /** @type {Error} */ (error).message;
    }
    if (live.contains(document.activeElement)) button.focus();
    live.hidden = true;
    setActive(button, true);
    onEnd();
  }

  cancel.addEventListener("click", async () => {
    setActive(cancel, false);
    message.textContent = translate("cancelling…");
    await call("DELETE", `/jobs/${job.id}?cancel_only=true`).catch((error) => {
      problem.textContent = error.message;
      setActive(cancel, true);
    });
  });

  /** @param {Job} current */
  function show(current) {
    bar.value = current.progress.fraction;
    message.textContent = jobHeadline(current) || current.state;
  }

  return (/** @type {string} */ jobId) => run(() => call("GET", `/jobs/${jobId}`));
}
