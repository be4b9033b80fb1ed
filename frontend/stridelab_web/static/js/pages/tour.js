// A tour of four steps on the home page, shown at the first visit and with `?tour=1`; it can be left at any step.
import { createElement } from "../shared/elements.js";
import { setActive } from "../shared/focus.js";
import { translate } from "../shared/translate.js";

const KEY = "stridelab-tour",
  DONE = "done";

const STEPS = [
  {
    target: "[data-tour=sample]",
    title: translate("See a result"),
    text: translate(
      "A simulated walk opens in 3D with its centre of mass and the 95 % band. Nothing has to be uploaded.",
    ),
  },
  {
    target: "[data-tour=upload]",
    title: translate("Give a recording"),
    text: translate(
      "Drop a C3D, TRC, TSV or CSV here. It is checked at once; its page says what is measured, and estimates with one button.",
    ),
  },
  {
    target: "[data-tour=robots]",
    title: translate("Let a robot climb"),
    text: translate(
      "Plan computes a motion over given contacts and checks it. New scenario makes stairs, ramps and rails of your own.",
    ),
  },
  {
    target: "[data-tour=help]",
    title: translate("Read on"),
    text: translate("Help leads from every page to its chapter of the book; ? in a 3D view lists the keys."),
  },
];

const storage = {
  read: () => {
    try {
      return localStorage.getItem(KEY);
    } catch {
      return DONE; // without storage the tour would come at every visit
    }
  },
  write: () => {
    try {
      localStorage.setItem(KEY, DONE);
    } catch {
      // the tour is only shown once anyway
    }
  },
};

if (new URLSearchParams(location.search).has("tour") || storage.read() !== DONE) start();

function start() {
  let step = 0;
  const title = createElement("h2", {}),
    text = createElement("p", {}),
    place = createElement("span", { className: "hint" });
  const next = createElement("button", { type: "button", className: "primary" });
  const back = createElement("button", { type: "button" }, translate("Back"));
  const leave = createElement("button", { type: "button" }, translate("Leave the tour"));
  const card = createElement(
    "section",
    { className: "card tour", ariaLabel: translate("Tour") },
    title,
    text,
    createElement("div", { className: "actions" }, next, back, leave, place),
  );
  next.addEventListener("click", () => (step + 1 < STEPS.length ? show(step + 1) : end()));
  back.addEventListener("click", () => show(step - 1));
  leave.addEventListener("click", end);
  card.addEventListener("keydown", (/** @type {KeyboardEvent} */ event) => event.key === "Escape" && end());
  document.querySelector("main")?.prepend(card);
  show(0);

  /** @param {number} k */
  function show(k) {
    step = k;
    title.textContent = STEPS[k].title;
    text.textContent = STEPS[k].text;
    place.textContent = translate("%(step)s of %(number)s", { step: k + 1, number: STEPS.length });
    next.textContent = k + 1 < STEPS.length ? translate("Next") : translate("Done");
    setActive(back, k > 0);
    mark(document.querySelector(STEPS[k].target));
  }

  /** @param {PageElement | null} target */
  function mark(target) {
    for (const node of document.querySelectorAll(".shown-by-tour")) node.classList.remove("shown-by-tour");
    target?.classList.add("shown-by-tour");
    target?.scrollIntoView({ block: "nearest" });
  }

  // The keyboard goes on at what the last step showed.
  /** @param {string} selector */
  function focusShown(selector) {
    const shown = /** @type {PageElement | null} */ (document.querySelector(selector));
    const inside = /** @type {PageElement | null} */ (shown?.querySelector("a[href], button, input"));
    (inside ?? shown)?.focus();
  }

  function end() {
    storage.write();
    mark(null);
    if (card.contains(document.activeElement)) focusShown(STEPS[step].target);
    card.remove();
  }
}
