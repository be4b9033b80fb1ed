// The page "New scenario": obstacles in a row, drawn while they change; then contacts, and on request the motion.
import { createElement, smallButton } from "../shared/elements.js";
import { courseBody, KINDS, moveItem, newElement } from "./course_fields.js";
import { bindCourseButton, startPlan } from "./planning_jobs.js";

const DRAW_AFTER_MS = 150;

const form = /** @type {any} */ (document.querySelector("form[data-course]"));
const list = form.querySelector("[data-elements]");
const pictures = form.querySelector("[data-pictures]");
const status = form.querySelector("[data-course-said]");
let elements = [newElement("stairs")];
let timer = 0;
let drawn = 0;

const kinds = Object.entries(KINDS);
form.querySelector("[data-add]").append(
  ...kinds.map(([kind, { title }]) => {
    const button = smallButton(title, `Add: ${title}`);
    button.addEventListener("click", () => change([...elements, newElement(kind)]));
    return button;
  }),
);
form.addEventListener("submit", (event) => event.preventDefault());
form.addEventListener("input", () => drawSoon());

bindCourseButton(form, "plan", course, async (stored) => {
  const job = await startPlan(stored.id);
  location.assign(`/plans/${job.id}?watch=1`);
});
bindCourseButton(form, "place", course, (stored) => location.assign(`/view/?scenario=${stored.id}`));

showElements();

function course() {
  if (!elements.length) throw new Error("Add an obstacle.");
  if (!form.reportValidity()) throw new Error("A number is missing or outside of its range.");
  const number = (name) => form.elements[name].valueAsNumber;
  const [name, robot, handrails] = ["name", "robot", "handrails"].map((field) => form.elements[field].value);
  return courseBody({ name, robot, handrails, friction: number("friction"), width_m: number("width_m") }, elements);
}

function change(next) {
  elements = next;
  showElements();
}

function showElements() {
  list.replaceChildren(...elements.map(elementRow));
  drawSoon();
}

function elementRow(element, index) {
  const { title, fields } = KINDS[element.kind];
  const place = `${title}, obstacle ${index + 1}`;
  const inputs = fields.map((field) => {
    const { name, label, unit, min, max, step } = field;
    const ariaLabel = `${label}${unit && ` in ${unit}`} of ${place}`;
    const value = String(element.values[name]);
    const input = createElement("input", { type: "number", min, max, step, value, required: true, ariaLabel });
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
  /** @type {[string, string, () => void][]} */
  const actions = [
    ["↑", "Earlier", () => change(moveItem(elements, index, -1))],
    ["↓", "Later", () => change(moveItem(elements, index, 1))],
    ["Remove", "Remove", () => change(elements.filter((_, k) => k !== index))],
  ];
  const buttons = actions.map(([text, label, onClick]) => {
    const button = smallButton(text, `${label}: ${place}`);
    button.addEventListener("click", onClick);
    return button;
  });
  return createElement("li", {}, createElement("strong", {}, title), ...inputs, ...buttons);
}

function drawSoon() {
  clearTimeout(timer);
  timer = setTimeout(draw, DRAW_AFTER_MS);
}

// Draws the course; an answer that a later one has overtaken is dropped.
async function draw() {
  const turn = ++drawn;
  if (!elements.length || !form.checkValidity()) {
    status.textContent = elements.length ? "A number is missing or outside of its range." : "Add an obstacle.";
    return;
  }
  const query = new URLSearchParams({ course: JSON.stringify(course()) });
  const response = await fetch(`/scenarios/new/pictures?${query}`).catch(() => null);
  const text = response ? await response.text() : "The service does not answer. Is it still running?";
  if (turn !== drawn) return;
  status.textContent = response?.ok ? "" : text;
  if (response?.ok) pictures.innerHTML = text;
}
