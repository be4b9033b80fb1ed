// The list of a scenario's surfaces, one row each, which expands to its numbers, and buttons that add and remove them.
import { createElement, smallButton } from "../shared/elements.js";
import { replaceRows } from "../shared/focus.js";
import {
  addSurface,
  removeSurface,
  replaceSurface,
  SURFACE_FIELDS,
  setSurfaceNumber,
  surfaceNumbers,
} from "./terrain_edits.js";

export class TerrainList {
  // `onCommit(edit, message)` stores an edit.
  /** @param {PageElement} root @param {{ onCommit: (edit: ScenarioEdit, done: string) => void }} options */
  constructor(root, { onCommit }) {
    this.list = root.querySelector("[data-surfaces]");
    this.head = root.querySelector("[data-scenario-fields]");
    this.onCommit = onCommit;
    this.expanded = -1;
    this.shown = "";
    /** @type {any} */
    this.scenario = null; // a Scenario, once it is shown
    for (const field of this.head.elements) field.disabled = false;
    for (const button of root.querySelectorAll("[data-add-surface]")) {
      button.disabled = false;
      const kind = /** @type {"box" | "rail" | "wall"} */ (button.dataset.addSurface);
      button.addEventListener("click", () => {
        this.expanded = this.scenario.terrain.length;
        onCommit((scenario) => addSurface(scenario, kind), `Added a ${kind}.`);
      });
    }
    this.head.addEventListener("submit", (event) => event.preventDefault());
    this.head.addEventListener("change", () => {
      if (!(/** @type {any} */ (this.head).reportValidity())) return;
      const name = this.head.elements.name.value.trim(),
        friction = this.head.elements.friction.valueAsNumber;
      onCommit((scenario) => ({ ...scenario, name, friction }), "Stored.");
    });
  }

  /** @param {Scenario} scenario */
  show(scenario) {
    this.scenario = scenario;
    const key = JSON.stringify([scenario.terrain, scenario.name, scenario.friction, this.expanded]);
    if (key === this.shown) return; // the input that is being typed in stays
    this.shown = key;
    this.head.elements.name.value = scenario.name;
    this.head.elements.friction.value = String(scenario.friction);
    replaceRows(
      this.list,
      scenario.terrain.map((surface, k) => this.createRow(surface, k)),
    );
  }

  /** @param {Surface} surface @param {number} k */
  createRow(surface, k) {
    const isOpen = k === this.expanded;
    const button = createElement("button", { type: "button", className: "touch" }, surface.name);
    button.setAttribute("aria-expanded", String(isOpen));
    button.addEventListener("click", () => {
      this.expanded = isOpen ? -1 : k;
      this.show(this.scenario);
      this.list.children[k].querySelector("button").focus();
    });
    if (!isOpen) return createElement("li", {}, button);
    const numbers = surfaceNumbers(surface);
    const inputs = SURFACE_FIELDS[surface.kind].map(({ name, label, unit, step, min }) => {
      const value = String(Number(numbers[name].toFixed(4)));
      const input = createElement("input", { type: "number", step, min: min ?? "", value, name, required: true });
      input.addEventListener("change", () => {
        const typed = input.valueAsNumber;
        if (!Number.isFinite(typed) || (input.validity.rangeUnderflow && !input.reportValidity())) return;
        const edit = (/** @type {Scenario} */ scenario) =>
          replaceSurface(scenario, k, setSurfaceNumber(scenario.terrain[k], name, typed));
        this.onCommit(edit, `${surface.name} stored.`);
      });
      return createElement("label", {}, `${label} `, input, ` ${unit}`);
    });
    const remove = smallButton("Remove", `Remove: ${surface.name}`);
    remove.classList.add("danger");
    remove.addEventListener("click", () => {
      this.expanded = -1;
      this.onCommit((scenario) => removeSurface(scenario, k), `${surface.name} removed.`);
    });
    const hint = createElement("p", { className: "hint" }, "Contacts on it move with it.");
    return createElement("li", {}, button, createElement("div", { className: "numbers" }, ...inputs, hint, remove));
  }
}
