// A notice on the page while the service does not answer; it is asked again every few seconds, then the notice disappears.
import { createElement } from "./elements.js";
import { translate } from "./translate.js";

const RETRY_MS = 3000,
  SHOWN_MS = 5000;
const LOST = translate("The service does not answer. The page keeps what it shows and retries every few seconds.");
const RESTORED = translate("The service answers again.");
/** @type {any} */
let notice = null,
  timer = 0;

// Call after a failed request: shows the notice if the service does not answer.
export async function checkConnection() {
  if (timer) return;
  timer = setTimeout(retry, RETRY_MS);
  if (await isServiceUp()) {
    clearTimeout(timer);
    timer = 0;
  } else showNotice(LOST);
}

async function retry() {
  clearTimeout(timer);
  timer = setTimeout(retry, RETRY_MS);
  if (!(await isServiceUp())) return showNotice(LOST);
  clearTimeout(timer);
  timer = 0;
  if (!notice || notice.hidden) return;
  showNotice(RESTORED);
  setTimeout(() => {
    if (!timer) notice.hidden = true;
  }, SHOWN_MS);
}

async function isServiceUp() {
  const response = await fetch("/api/v1/health", { cache: "no-store" }).catch(() => null);
  return Boolean(response?.ok);
}

/** @param {string} text */
function showNotice(text) {
  notice ??= createNotice();
  notice.hidden = false;
  const paragraph = notice.querySelector("p");
  if (paragraph.textContent !== text) paragraph.textContent = text;
  notice.querySelector("button").hidden = text === RESTORED;
}

function createNotice() {
  const button = createElement("button", { className: "small" }, translate("Retry now"));
  button.addEventListener("click", retry);
  const paragraph = createElement("p", { role: "status" });
  const box = createElement("aside", { className: "lost", ariaLabel: translate("Connection") }, paragraph, button);
  document.querySelector("header.top").after(box);
  return box;
}
