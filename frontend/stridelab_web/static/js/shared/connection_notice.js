// Where the service does not answer: one calm sentence on the page, asked again until it does, then gone by itself.
const AGAIN_MS = 3000,
  SAID_MS = 5000;
const LOST = "The service does not answer. What you see here stays; it is asked again every few seconds.";
const BACK = "The service answers again.";
/** @type {any} */
let notice = null,
  later = 0;

// To be called when something failed: asks whether the service is there at all.
export async function doubt() {
  if (later) return;
  later = setTimeout(again, AGAIN_MS);
  if (await answers()) {
    clearTimeout(later);
    later = 0;
  } else tell(LOST);
}

async function again() {
  clearTimeout(later);
  later = setTimeout(again, AGAIN_MS);
  if (!(await answers())) return tell(LOST);
  clearTimeout(later);
  later = 0;
  if (!notice || notice.hidden) return;
  tell(BACK);
  setTimeout(() => {
    if (!later) notice.hidden = true;
  }, SAID_MS);
}

async function answers() {
  const answer = await fetch("/api/v1/health", { cache: "no-store" }).catch(() => null);
  return Boolean(answer?.ok);
}

function tell(text) {
  notice ??= made();
  notice.hidden = false;
  const said = notice.querySelector("p");
  if (said.textContent !== text) said.textContent = text;
  notice.querySelector("button").hidden = text === BACK;
}

function made() {
  const box = document.createElement("aside"),
    said = document.createElement("p"),
    button = document.createElement("button");
  box.className = "lost";
  box.setAttribute("aria-label", "Connection");
  said.setAttribute("role", "status");
  button.className = "small";
  button.textContent = "Ask now";
  button.addEventListener("click", again);
  box.append(said, button);
  document.querySelector("header.top").after(box);
  return box;
}
