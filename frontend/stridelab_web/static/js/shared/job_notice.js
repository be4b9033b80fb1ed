// A notification of the browser at the end of a job whose page is in the background: what it was, and its verdict. Asked
// for once by the checkbox `[data-notify]`, which is shown where the browser offers notifications.
import { translate, translateServed } from "./translate.js";

const KEY = "stridelab-notify",
  ON = "on";
const MARKS = { passed: "✓", doubtful: "!", failed: "✗" }; // as in the titles of pages (formatting.py)

const isOffered = () => "Notification" in globalThis && Notification.permission !== "denied";

function isOn() {
  try {
    return isOffered() && Notification.permission === "granted" && localStorage.getItem(KEY) === ON;
  } catch {
    return false; // storage is disabled
  }
}

// Whether jobs are to be followed in the background, too.
export const isNoticeWanted = isOn;

// The outcome of a job in one line: the verdict on its result, else why it ended.
/** @param {Job} job @returns {string} */
export function outcomeText(job) {
  if (job.verdict) return `${MARKS[job.verdict.outcome]} ${translateServed(job.verdict.message)}`;
  const ended = translate(job.state.replaceAll("_", " "));
  if (job.error) return `${MARKS.failed} ${translateServed(job.error.detail || job.error.title)}`;
  return `${job.state === "succeeded" ? MARKS.passed : MARKS.failed} ${ended}`;
}

// Shows the outcome of a job that has ended, if its reader looks elsewhere and wants to know.
/** @param {Job} job @param {string} [title] */
export function notifyOfEnd(job, title = document.title.replace(/ · stridelab$/, "")) {
  if (!document.hidden || !isOn()) return;
  try {
    const notice = new Notification(title, { body: outcomeText(job), icon: "/static/favicon.svg", tag: job.id });
    notice.addEventListener("click", () => {
      focus();
      notice.close();
    });
  } catch {
    // browsers of phones have the class and refuse to use it in pages
  }
}

for (const label of globalThis.document?.querySelectorAll("[data-notify]") ?? []) offer(label);

/** @param {any} label */
function offer(label) {
  const box = label.querySelector("input");
  label.hidden = !isOffered();
  box.checked = isOn();
  box.addEventListener("change", async () => {
    if (box.checked && (await Notification.requestPermission()) !== "granted") {
      box.checked = false;
      label.append(" ", translate("The browser does not allow notifications of this address."));
    }
    try {
      localStorage.setItem(KEY, box.checked ? ON : "off");
    } catch {
      box.checked = false; // storage is disabled
    }
  });
}
