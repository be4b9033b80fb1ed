// The list of a scenario's touches: one row each, which opens to numbers and margins.
import { contactIn, endsOf } from "./phase_edits.js";
import { yawOf } from "../viewer/quaternions.js";
import { named } from "./validation_text.js";

export class Rows {
  // `on` hears of what happens to a row: choose(number), nudge(event, number), preview and typed(number, input), left().
  constructor(root, own, on) {
    this.list = root.querySelector("[data-touches]");
    this.model = root.querySelector("template[data-row]");
    this.own = own;
    this.on = on;
    this.typing = null;
    this.byNumber = new Map();
  }

  // Whether there is a row for each touch, in the same order.
  fits(touches) {
    return (
      this.byNumber.size === touches.length &&
      touches.every((touch) => this.byNumber.get(touch.number)?.dataset.effector === touch.effector)
    );
  }

  // One row for each touch.
  fill(touches) {
    this.byNumber.clear();
    this.list.replaceChildren();
    for (const touch of touches) this.add(touch);
  }

  add(touch) {
    const row = this.model.content.firstElementChild.cloneNode(true);
    const find = (name) => row.querySelector(`[data-${name}]`);
    row.dataset.effector = touch.effector;
    find("dot").classList.add(touch.side);
    find("number").textContent = touch.number;
    find("name").textContent = named(touch.effector);
    find("yaw").hidden = !touch.surface;
    const button = row.querySelector("button");
    button.addEventListener("click", () => this.on.choose(touch.number));
    button.addEventListener("keydown", (event) => this.on.nudge(event, touch.number));
    for (const input of row.querySelectorAll("input")) {
      input.disabled = !this.own;
      input.addEventListener("input", () => {
        this.typing = input;
        this.on.preview(touch.number, input);
      });
      input.addEventListener("change", () => {
        this.typing = null;
        this.on.typed(touch.number, input);
      });
      input.addEventListener("blur", () => {
        this.typing = null;
        this.on.left();
      });
    }
    this.byNumber.set(touch.number, row);
    this.list.append(row);
  }

  // Opens one row and closes the others; null closes all.
  open(number) {
    for (const [other, row] of this.byNumber) {
      row.querySelector("button").setAttribute("aria-expanded", String(other === number));
      row.querySelector(".numbers").hidden = other !== number;
    }
    if (number !== null) this.byNumber.get(number).scrollIntoView({ block: "nearest" });
  }

  // Writes into a row where and when its touch is in `body`; a number that is being typed stays.
  write(touch, body) {
    const row = this.byNumber.get(touch.number),
      [first, last] = touch.phases,
      ends_s = endsOf(body);
    const { position_m: position, orientation_wxyz } = contactIn(body, first, touch.effector);
    const when = [ends_s[first] - body.phases[first].duration_s, ends_s[last]]
      .map((t_s) => `${t_s.toFixed(2)} s`)
      .join(" to ");
    row.querySelector("[data-when]").textContent =
      `${first === last ? `Phase ${first}` : `Phases ${first} to ${last}`}, ${when}`;
    row.querySelector("[data-place]").textContent = position.map((v) => v.toFixed(3)).join(", ");
    const values = { x: position[0], y: position[1], z: position[2], yaw: yawOf(orientation_wxyz) };
    for (const input of row.querySelectorAll("input")) {
      const text = String(Number(values[input.name].toFixed(input.name === "yaw" ? 1 : 4)));
      if (input !== this.typing && input.value !== text) input.value = text;
    }
  }

  // How far a touch is from being refused: [what, sentence] pairs.
  margins(number, lines) {
    const list = this.byNumber.get(number).querySelector("[data-margins]");
    const texts = lines.flat();
    while (list.children.length < texts.length)
      list.append(document.createElement(list.children.length % 2 ? "dd" : "dt"));
    while (list.children.length > texts.length) list.lastElementChild.remove();
    for (const [k, text] of texts.entries())
      if (list.children[k].textContent !== text) list.children[k].textContent = text;
  }
}
