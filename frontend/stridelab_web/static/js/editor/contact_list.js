// The list of a scenario's contacts, one row each, which expands to its coordinates and margins. A touch is the contact of
// one effector that stays at its place during consecutive phases.
import { contactOf, phaseEndTimes } from "./phase_edits.js";
import { yawDegrees } from "../viewer/quaternions.js";
import { effectorLabel } from "./validation_text.js";

export class ContactList {
  // `callbacks` are called with the number of the touch: onChoose(number), onKey(event, number), onInput(number, input),
  // onCommit(number, input), onLeave().
  /**
   * @param {PageElement} root
   * @param {{ onChoose(number: number): void; onKey(event: KeyboardEvent, number: number): void; onInput(number: number, input: PageElement): void; onCommit(number: number, input: PageElement): void; onLeave(): void }} callbacks
   */
  constructor(root, callbacks) {
    this.list = root.querySelector("[data-touches]");
    this.template = root.querySelector("template[data-row]");
    this.callbacks = callbacks;
    this.typedInput = null;
    this.byNumber = new Map();
  }

  // Whether each touch has a row with the same number and effector.
  /** @param {Touch[]} touches */
  matches(touches) {
    return (
      this.byNumber.size === touches.length &&
      touches.every((touch) => this.byNumber.get(touch.number)?.dataset.effector === touch.effector)
    );
  }

  // Replaces all rows.
  /** @param {Touch[]} touches */
  rebuild(touches) {
    this.byNumber.clear();
    this.list.replaceChildren();
    for (const touch of touches) this.addRow(touch);
  }

  /** @param {Touch} touch */
  addRow(touch) {
    const row = this.template.content.firstElementChild.cloneNode(true);
    const find = (/** @type {string} */ name) => row.querySelector(`[data-${name}]`);
    row.dataset.effector = touch.effector;
    find("dot").classList.add(touch.side);
    find("number").textContent = String(touch.number);
    find("name").textContent = effectorLabel(touch.effector);
    find("yaw").hidden = !touch.surface;
    const button = row.querySelector("button");
    button.addEventListener("click", () => this.callbacks.onChoose(touch.number));
    button.addEventListener("keydown", (event) => this.callbacks.onKey(event, touch.number));
    for (const input of row.querySelectorAll("input")) {
      input.addEventListener("input", () => {
        this.typedInput = input;
        this.callbacks.onInput(touch.number, input);
      });
      input.addEventListener("change", () => {
        this.typedInput = null;
        this.callbacks.onCommit(touch.number, input);
      });
      input.addEventListener("blur", () => {
        this.typedInput = null;
        this.callbacks.onLeave();
      });
    }
    this.byNumber.set(touch.number, row);
    this.list.append(row);
  }

  // Expands one row and collapses the others; null collapses all.
  /** @param {number | null} number */
  expandRow(number) {
    for (const [other, row] of this.byNumber) {
      row.querySelector("button").setAttribute("aria-expanded", String(other === number));
      row.querySelector(".numbers").hidden = other !== number;
    }
    if (number !== null) this.byNumber.get(number).scrollIntoView({ block: "nearest" });
  }

  // Writes the position and times of a touch into its row; the input that is being typed in stays unchanged.
  /** @param {Touch} touch @param {Scenario} scenario */
  updateRow(touch, scenario) {
    const row = this.byNumber.get(touch.number),
      [first, last] = touch.phases,
      ends_s = phaseEndTimes(scenario);
    const { position_m: position, orientation_wxyz } = contactOf(scenario, touch);
    const when = [ends_s[first] - scenario.phases[first].duration_s, ends_s[last]]
      .map((t_s) => `${t_s.toFixed(2)} s`)
      .join(" to ");
    row.querySelector("[data-when]").textContent =
      `${first === last ? `Phase ${first}` : `Phases ${first} to ${last}`}, ${when}`;
    row.querySelector("[data-place]").textContent = position.map((v) => v.toFixed(3)).join(", ");
    /** @type {Record<string, number>} */
    const values = { x: position[0], y: position[1], z: position[2], yaw: yawDegrees(orientation_wxyz) };
    for (const input of row.querySelectorAll("input")) {
      const text = String(Number(values[input.name].toFixed(input.name === "yaw" ? 1 : 4)));
      if (input !== this.typedInput && input.value !== text) input.value = text;
    }
  }

  // Shows the margins of a touch, [name, sentence] pairs.
  /** @param {number} number @param {string[][]} lines */
  showMargins(number, lines) {
    const list = this.byNumber.get(number).querySelector("[data-margins]");
    const texts = lines.flat();
    while (list.children.length < texts.length)
      list.append(document.createElement(list.children.length % 2 ? "dd" : "dt"));
    while (list.children.length > texts.length) list.lastElementChild.remove();
    for (const [k, text] of texts.entries())
      if (list.children[k].textContent !== text) list.children[k].textContent = text;
  }
}
