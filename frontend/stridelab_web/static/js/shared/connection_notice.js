// A notice on the page while the service does not answer, or while the login has ended; it disappears by itself afterwards.
import { createElement } from "./elements.js";
import { translate } from "./translate.js";

const RETRY_MS = 3000,
  ANSWER_MS = 6000, // a network that carries nothing does not end a request
  LOGIN_RETRY_MS = 20_000, // each refusal is a line in the log of the service
  SHOWN_MS = 5000;
const TEXTS = {
  lost: translate("The service does not answer. The page keeps what it shows and retries every few seconds."),
  login: translate(
    "Your login has ended. The page keeps what it shows and goes on once you have logged in again in a new tab.",
  ),
  restored: translate("The service answers again."),
  known: translate("You are logged in again."),
};
/** @type {any} */
let notice = null,
  timer = 0,
  /** @type {Promise<void> | null} */
  checking = null,
  /** @type {(() => void)[]} */
  waiting = [],
  /** @type {"up" | "lost" | "login"} */
  state = "up";

// Call after a failed request, or where an answer is late: shows the notice if the service does not answer, or knows the
// caller no more.
export async function checkConnection() {
  if (!timer) await retry();
}

// Resolves once the service answers and knows the caller, for requests that failed because it did not.
export async function untilAnswering() {
  await checkConnection();
  if (state === "up") return new Promise((done) => setTimeout(done, RETRY_MS)); // that request only was lost
  return new Promise((/** @type {(value?: void) => void} */ done) => waiting.push(done));
}

// Calls `action` each time that the service answers again, or knows the caller again.
/** @param {() => void} action */
export const onRestored = (action) => document.addEventListener("connection-restored", action);

// Whether the service answers, as far as the last check knows.
export const isAnswering = () => state !== "lost";

// Whether requests are refused until the reader has logged in again.
export const isLoggedOut = () => state === "login";

function retry() {
  checking ??= updateState().finally(() => {
    checking = null;
  });
  return checking;
}

async function updateState() {
  clearTimeout(timer);
  const before = state;
  state = await connectionState();
  timer = state === "up" ? 0 : setTimeout(retry, state === "login" ? LOGIN_RETRY_MS : RETRY_MS);
  if (state !== "up") return showNotice(state);
  for (const done of waiting.splice(0)) done();
  if (!notice || notice.hidden) return;
  if (before !== "up") document.dispatchEvent(new Event("connection-restored"));
  showNotice(before === "login" ? "known" : "restored");
  setTimeout(() => {
    if (!timer) notice.hidden = true;
  }, SHOWN_MS);
}

async function connectionState() {
  const get = (/** @type {string} */ path) =>
    fetch(`/api/v1/${path}`, { cache: "no-store", signal: AbortSignal.timeout(ANSWER_MS) }).catch(() => null);
  const health = await get("health");
  if (!health?.ok) return "lost";
  return (await get("caller"))?.status === 401 ? "login" : "up";
}

/** @param {keyof typeof TEXTS} kind */
function showNotice(kind) {
  notice ??= createNotice();
  notice.hidden = false;
  const paragraph = notice.querySelector("p");
  if (paragraph.textContent !== TEXTS[kind]) paragraph.textContent = TEXTS[kind];
  notice.querySelector("button").hidden = kind === "restored" || kind === "known";
  notice.querySelector("a").hidden = kind !== "login";
}

function createNotice() {
  const button = createElement("button", { className: "small" }, translate("Retry now"));
  button.addEventListener("click", retry);
  addEventListener("focus", () => isLoggedOut() && retry()); // back from the tab of the login
  const link = createElement("a", { href: "/login", target: "_blank" }, translate("Log in"));
  const paragraph = createElement("p", { role: "status" });
  const box = createElement(
    "aside",
    { className: "lost", ariaLabel: translate("Connection") },
    paragraph,
    link,
    button,
  );
  document.querySelector("header.top").after(box);
  return box;
}
