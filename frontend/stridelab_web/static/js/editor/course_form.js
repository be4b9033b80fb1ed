// The page "New scenario": obstacles in a row, drawn while they change by typing or by handles; then contacts, and on request
// the motion. Every change can be undone.
import { call } from "../shared/api.js";
import { untilAnswering } from "../shared/connection_notice.js";
import { createElement, smallButton } from "../shared/elements.js";
import { focusRow, replaceRows, setActive } from "../shared/focus.js";
import { courseBody, dragElement, KINDS, MAX_ELEMENTS, moveItem, newElement } from "./course_fields.js";
import { CourseHistory } from "./course_history.js";
import { PRESETS, presetCourse } from "./course_presets.js";
import { bindTaskButton, planningUrl, startPlan } from "./planning_jobs.js";

const DRAW_AFTER_MS = 100,
  PX_PER_M = 200; // of the drawing (charts/scenario_drawing.py)
const UNAUTHENTICATED = 401;
const WHOLE = "numeric"; // the input mode of counts
const HEAD = ["name", "robot", "handrails", "width_m", "friction"];

const form = /** @type {any} */ (document.querySelector("form[data-course]"));
const part = (/** @type {string} */ name) => form.querySelector(`[data-${name}]`);
const [list, pictures, status, undo, redo] = ["elements", "pictures", "course-said", "undo", "redo"].map(part);
const readHead = () => Object.fromEntries(HEAD.map((name) => [name, form.elements[name].value]));
const history = new CourseHistory("stridelab-course", { head: readHead(), elements: [newElement("stairs")] });
let { elements } = history.present;
let timer = 0;
let drawn = 0;

part("add").append(
  ...Object.entries(KINDS).map(([kind, { title }]) => {
    const button = smallButton(title, `Add: ${title}`);
    button.addEventListener("click", () => change([...elements, newElement(kind)]));
    return button;
  }),
);
for (const [key, { title }] of Object.entries(PRESETS)) form.elements.preset.add(new Option(title, key));
form.elements.preset.addEventListener("change", () => {
  const key = form.elements.preset.value;
  form.elements.preset.value = "";
  if (key) show(presetCourse(key, readHead())); // recorded as any change of the form
});
form.addEventListener("submit", (/** @type {PointerEvent} */ event) => event.preventDefault());
form.addEventListener("input", (/** @type {Event} */ event) => acceptBetweenSteps(event.target), { capture: true });
form.addEventListener("input", () => drawSoon());
form.addEventListener("change", () => form.checkValidity() && record());
undo.addEventListener("click", () => show(history.undo()));
redo.addEventListener("click", () => show(history.redo()));
// In a text field, Ctrl+Z undoes the typing instead.
document.addEventListener("keydown", (event) => {
  const key = event.key.toLowerCase();
  if (!(event.ctrlKey || event.metaKey) || !["z", "y"].includes(key)) return;
  if (/** @type {PageElement} */ (event.target).matches("input")) return;
  event.preventDefault();
  show(key === "y" || event.shiftKey ? history.redo() : history.undo());
});
pictures.addEventListener("pointerdown", startDrag);

bindTaskButton(form, "plan", task, async (stored) => {
  const job = await startPlan(stored.id);
  location.assign(planningUrl(stored.id, job.id));
});
bindTaskButton(form, "place", task, (stored) => location.assign(`/view/?scenario=${stored.id}`));

show(history.present);

async function task() {
  return call("POST", "/scenarios/compose", course());
}

function course() {
  form.reportValidity();
  const problem = courseProblem();
  if (problem) throw new Error(problem);
  const number = (/** @type {string} */ name) => form.elements[name].valueAsNumber;
  const [name, robot, handrails] = ["name", "robot", "handrails"].map((field) => form.elements[field].value);
  return courseBody({ name, robot, handrails, friction: number("friction"), width_m: number("width_m") }, elements);
}

// Real stairs are 17.3 cm high: the step of a number is what arrow keys add, not what may be typed.
/** @param {any} input */
function acceptBetweenSteps(input) {
  if (input.validity.stepMismatch && input.inputMode !== WHOLE) input.step = "any";
}

// Why the course cannot be composed; an empty string if it can.
function courseProblem() {
  if (!elements.length) return "Add an obstacle.";
  if (elements.length > MAX_ELEMENTS) return `A course has at most ${MAX_ELEMENTS} obstacles.`;
  const input = form.querySelector("input:invalid");
  if (!input) return "";
  const label = input.ariaLabel ?? input.labels[0].firstChild.textContent.trim();
  const number = input.inputMode === WHOLE ? "whole number" : "number";
  return input.type === "number" ? `${label}: a ${number} from ${input.min} to ${input.max}.` : `${label}: missing.`;
}

/** @param {import("./course_fields.js").CourseElement[]} next */
function change(next) {
  elements = next;
  record();
  showElements();
}

function showHistory() {
  setActive(undo, history.canUndo);
  setActive(redo, history.canRedo);
}

function record() {
  history.record(structuredClone({ head: readHead(), elements }));
  showHistory();
}

// Shows a state of the history.
/** @param {typeof history.present} state */
function show(state) {
  for (const name of HEAD) form.elements[name].value = state.head[name];
  elements = structuredClone(state.elements);
  showHistory();
  showElements();
}

function showElements() {
  replaceRows(list, elements.map(elementRow));
  for (const input of form.elements) acceptBetweenSteps(input);
  drawSoon();
}

/** @param {import("./course_fields.js").CourseElement} element @param {number} index */
function elementRow(element, index) {
  const { title, fields } = KINDS[element.kind];
  const place = `${title}, obstacle ${index + 1}`;
  const inputs = fields.map((field) => {
    const { name, label, unit, min, max, step } = field;
    const ariaLabel = `${label}${unit && ` in ${unit}`} of ${place}`;
    const value = String(element.values[name]);
    const inputMode = name === "number" ? WHOLE : ""; // a decimal keyboard of a phone may have no minus
    const input = createElement("input", {
      type: "number",
      inputMode,
      min,
      max,
      step,
      value,
      required: true,
      ariaLabel,
    });
    input.addEventListener("input", () => {
      if (input.validity.valid) element.values[name] = input.valueAsNumber;
    });
    return createElement(
      "label",
      {},
      `${label} `,
      createElement("span", { className: "with-unit" }, input, ` ${unit}`),
    );
  });
  const move = (/** @type {number} */ by) => {
    const place = index + by;
    change(moveItem(elements, index, by));
    focusRow(list, Math.max(place, 0), inputs.length + (by < 0 ? 0 : 1)); // its own button, where it is now
  };
  const remove = () => {
    change(elements.filter((_, k) => k !== index));
    focusRow(list, index, Infinity, part("add").querySelector("button"));
  };
  /** @type {[string, string, () => void][]} */
  const actions = [
    ["↑", "Earlier", () => move(-1)],
    ["↓", "Later", () => move(1)],
    ["Remove", "Remove", () => remove()],
  ];
  const buttons = actions.map(([text, label, onClick]) => {
    const button = smallButton(text, `${label}: ${place}`);
    button.addEventListener("click", onClick);
    return button;
  });
  return createElement("li", {}, createElement("strong", {}, title), ...inputs, ...buttons);
}

// A drag of a handle in the side view. The drawing is exchanged meanwhile, so the document listens.
/** @param {PointerEvent} event */
function startDrag(event) {
  const handle = /** @type {any} */ (event.target).closest("[data-handle]");
  if (!handle || event.button !== 0) return;
  event.preventDefault();
  const index = Number(handle.dataset.handle),
    before = elements[index],
    { clientX, clientY } = event;
  const m_per_pixel = 1 / handle.getScreenCTM().a / PX_PER_M;
  const onMove = (/** @type {PointerEvent} */ move) => {
    const [ahead_m, up_m] = [move.clientX - clientX, clientY - move.clientY].map((px) => px * m_per_pixel);
    elements = elements.with(index, dragElement(before, ahead_m, up_m));
    showElements();
  };
  const onEnd = (/** @type {Event} */ end) => {
    for (const [name, listener] of Object.entries(listeners)) document.removeEventListener(name, listener);
    if (end.type === "pointercancel") change(elements.with(index, before));
    else record();
  };
  /** @type {Record<string, (event: any) => void>} */
  const listeners = { pointermove: onMove, pointerup: onEnd, pointercancel: onEnd };
  for (const [name, listener] of Object.entries(listeners)) document.addEventListener(name, listener);
}

function drawSoon() {
  if (!timer) timer = setTimeout(draw, DRAW_AFTER_MS);
}

// Draws the course; an answer that a later one has overtaken is dropped.
async function draw() {
  timer = 0;
  const turn = ++drawn;
  status.textContent = courseProblem();
  if (status.textContent) return;
  const query = new URLSearchParams({ course: JSON.stringify(course()) });
  const response = await fetch(`/scenarios/new/pictures?${query}`).catch(() => null);
  if (!response || response.status === UNAUTHENTICATED) {
    await untilAnswering();
    if (turn === drawn) draw();
    return;
  }
  const text = await response.text();
  if (turn !== drawn) return;
  status.textContent = response.ok ? "" : text;
  if (response.ok) pictures.innerHTML = text;
}
