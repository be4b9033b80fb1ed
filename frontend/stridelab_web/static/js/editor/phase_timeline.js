// The phases over time: a bar per phase, a lane per effector, and borders that can be dragged or moved by arrow keys.
import { endsOf, ending } from "./phase_edits.js";
import { named, sentenceOfPhase } from "./validation_text.js";

const STEPS = { ArrowLeft: (k) => k - 1, ArrowRight: (k) => k + 1, Home: () => 0, End: (_, last) => last };
const BY = { ArrowLeft: -1, ArrowRight: 1, ArrowDown: -1, ArrowUp: 1 };
const COARSE_S = 0.05,
  FINE_S = 0.01,
  WIDER = 1.5,
  WIDEST = 12;

export class Strip {
  // `on` hears choose(k), touch(number), toggle(k, effector); and of borders: propose(edit), settle(edit, said), later(key, edit, said), back().
  constructor(root, own, on) {
    this.own = own;
    this.on = on;
    this.bars = [];
    this.borders = [];
    this.body = null;
    this.touches = [];
    this.chosen = null;
    this.held = null;
    this.wide = 1;
    this.phases = root.querySelector("[data-phases]");
    this.edges = root.querySelector("[data-borders]");
    this.width = root.querySelector("[data-lanes]");
    const each = (name) =>
      new Map([...root.querySelectorAll(`[data-${name}]`)].map((node) => [node.getAttribute(`data-${name}`), node]));
    this.lanes = each("lane");
    this.names = each("lane-name");
    this.phases.addEventListener("click", (event) => {
      const k = this.bars.indexOf(event.target.closest("button"));
      if (k >= 0) on.choose(k);
    });
    this.phases.addEventListener("keydown", (event) => this.step(event));
    for (const [effector, lane] of this.lanes) {
      lane.addEventListener("click", (event) => this.pick(effector, event));
      lane.addEventListener("dblclick", (event) => own && on.toggle(this.phaseAt(event), effector));
    }
    root.querySelector("[data-wider]").addEventListener("click", () => this.widen(this.wide * WIDER));
    root.querySelector("[data-narrower]").addEventListener("click", () => this.widen(this.wide / WIDER));
  }

  widen(wide) {
    this.wide = Math.min(Math.max(wide, 1), WIDEST);
    this.width.style.width = `${100 * this.wide}%`;
    this.bars[this.chosen]?.scrollIntoView({ inline: "center", block: "nearest" });
  }

  step(event) {
    const k = this.bars.indexOf(document.activeElement);
    if (k < 0 || !STEPS[event.key] || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    const to = Math.min(Math.max(STEPS[event.key](k, this.bars.length - 1), 0), this.bars.length - 1);
    this.bars[to].focus();
    this.on.choose(to);
  }

  pick(effector, event) {
    const k = this.phaseAt(event);
    const there = this.touches.find(
      (touch) => touch.effector === effector && touch.phases[0] <= k && k <= touch.phases[1],
    );
    if (there) this.on.touch(there.number);
    this.on.choose(k);
  }

  timeAt(event) {
    const box = this.width.getBoundingClientRect();
    return ((event.clientX - box.left) / box.width) * this.whole_s;
  }

  phaseAt(event) {
    const t_s = this.timeAt(event),
      k = endsOf(this.body).findIndex((end_s) => t_s < end_s);
    return k < 0 ? this.body.phases.length - 1 : k;
  }

  // What `body` is like; `touches` are those of the same phases. While a border is held, the scale stays.
  draw(body, touches) {
    Object.assign(this, { body, touches });
    const ends_s = endsOf(body);
    this.whole_s = this.held?.whole_s ?? ends_s.at(-1);
    if (this.bars.length !== body.phases.length) this.make();
    const start_s = (k) => (k > 0 ? ends_s[k - 1] : 0);
    for (const [k, bar] of this.bars.entries()) this.put(bar, start_s(k), ends_s[k]);
    for (const [k, border] of this.borders.entries()) {
      this.put(border, ends_s[k], ends_s[k]);
      border.setAttribute("aria-valuenow", ends_s[k].toFixed(3));
      border.setAttribute(
        "aria-valuetext",
        `${ends_s[k].toFixed(2)} seconds; phase ${k} lasts ${body.phases[k].duration_s.toFixed(2)} seconds`,
      );
      border.setAttribute("aria-valuemax", String(this.whole_s));
    }
    for (const [effector, lane] of this.lanes) {
      const own = touches.filter((touch) => touch.effector === effector);
      for (const node of [lane, this.names.get(effector)]) node.classList.toggle("idle", own.length === 0);
      while (lane.children.length < own.length) lane.append(document.createElement("i"));
      while (lane.children.length > own.length) lane.lastElementChild.remove();
      for (const [i, { phases, number, side }] of own.entries()) {
        lane.children[i].className = side;
        lane.children[i].textContent = number;
        this.put(lane.children[i], start_s(phases[0]), ends_s[phases[1]]);
      }
      const said = own
        .map(({ phases }) => `${start_s(phases[0]).toFixed(2)} s to ${ends_s[phases[1]].toFixed(2)} s`)
        .join("; ");
      lane.setAttribute("aria-label", `${named(effector)} touches ${said ? `from ${said}` : "nothing"}`);
    }
  }

  put(node, start_s, end_s) {
    node.style.left = `${(100 * start_s) / this.whole_s}%`;
    if (end_s > start_s) node.style.width = `${(100 * (end_s - start_s)) / this.whole_s}%`;
  }

  make() {
    this.bars = this.body.phases.map((_, k) => {
      const bar = document.createElement("button");
      bar.type = "button";
      bar.append(document.createElement("span"));
      bar.children[0].textContent = String(k);
      bar.tabIndex = -1;
      return bar;
    });
    this.phases.replaceChildren(...this.bars);
    this.borders = this.own ? this.body.phases.map((_, k) => this.border(k)) : [];
    this.edges.replaceChildren(...this.borders);
    this.mark();
  }

  border(k) {
    const border = document.createElement("div");
    for (const [name, value] of Object.entries({
      role: "slider",
      "aria-orientation": "horizontal",
      "aria-label": `End of phase ${k}`,
      "aria-valuemin": "0",
      tabindex: "-1",
    })) {
      border.setAttribute(name, value);
    }
    border.title = `End of phase ${k}: drag it, with Shift all that follows moves along`;
    const stop = () => {
      this.held = null;
      this.draw(this.body, this.touches);
    };
    border.addEventListener("pointerdown", (event) => {
      if (event.button !== 0) return;
      event.preventDefault();
      border.setPointerCapture(event.pointerId);
      border.focus();
      this.held = { k, whole_s: this.whole_s, offset_s: this.timeAt(event) - endsOf(this.body)[k], edit: null };
    });
    border.addEventListener("pointermove", (event) => {
      if (this.held?.k !== k) return;
      const to_s = Math.round((this.timeAt(event) - this.held.offset_s) / FINE_S) * FINE_S,
        rest = event.shiftKey;
      this.held.edit = (body) => ending(body, k, to_s, rest);
      this.on.propose(this.held.edit);
    });
    border.addEventListener("pointerup", () => {
      const edit = this.held?.edit;
      stop();
      if (edit) this.on.settle(edit, `End of phase ${k} stored.`);
    });
    border.addEventListener("pointercancel", () => {
      stop();
      this.on.back();
    });
    border.addEventListener("keydown", (event) => {
      if (event.key === "Escape" && this.held) {
        stop();
        return this.on.back();
      }
      if (!BY[event.key] || event.ctrlKey || event.metaKey || event.altKey) return;
      event.preventDefault();
      const to_s = endsOf(this.body)[k] + BY[event.key] * (event.shiftKey ? FINE_S : COARSE_S);
      this.on.later(`end ${k}`, (body) => ending(body, k, to_s, false), `End of phase ${k} stored.`);
    });
    return border;
  }

  // What the judge says of each phase, and which one is chosen. An answer about other phases than are shown comes late.
  judge(phases, chosen) {
    this.chosen = chosen;
    if (phases.length !== this.bars.length) return;
    for (const [k, bar] of this.bars.entries()) {
      const said = sentenceOfPhase(phases[k], k);
      bar.dataset.kind = phases[k].kind;
      bar.title = said;
      bar.setAttribute("aria-label", said);
    }
    this.mark();
  }

  // Of the phases one is a stop of the tab key, and so are its borders.
  mark() {
    for (const [k, bar] of this.bars.entries()) {
      bar.setAttribute("aria-pressed", String(k === this.chosen));
      bar.tabIndex = k === (this.chosen ?? 0) ? 0 : -1;
    }
    for (const [k, border] of this.borders.entries()) {
      const near = k === this.chosen || k === this.chosen - 1;
      border.tabIndex = near && this.chosen !== null ? 0 : -1;
      border.classList.toggle("near", near);
    }
  }
}
