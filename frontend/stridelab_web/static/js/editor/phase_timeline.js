// The timeline of the phases: one bar per phase, one lane per effector, and borders that are dragged or moved by arrow keys.
import { phaseEndTimes, movePhaseEnd } from "./phase_edits.js";
import { createElement } from "../shared/elements.js";
import { effectorLabel, phaseSentence } from "./validation_text.js";

/** @type {Record<string, (k: number, last: number) => number>} */
const TARGETS = {
  ArrowLeft: (k) => k - 1,
  ArrowRight: (k) => k + 1,
  Home: () => 0,
  End: (_, last) => last,
};
/** @type {Record<string, number>} */
const DIRECTIONS = { ArrowLeft: -1, ArrowRight: 1, ArrowDown: -1, ArrowUp: 1 };
const COARSE_STEP_S = 0.05,
  FINE_STEP_S = 0.01,
  ZOOM_STEP = 1.5,
  MAX_ZOOM = 12;

export class PhaseTimeline {
  // `callbacks`: onChoosePhase(k), onChooseContact(number), onToggle(k, effector); and for borders onPropose(edit),
  // onCommit(edit, message), onKeyEdit(key, edit, message), onDiscard().
  /** @param {PageElement} root @param {TimelineCallbacks} callbacks */
  constructor(root, callbacks) {
    this.callbacks = callbacks;
    /** @type {HTMLElement[]} */
    this.bars = [];
    /** @type {HTMLElement[]} */
    this.borders = [];
    /** @type {any} */
    this.scenario = null; // a Scenario, once it is drawn
    /** @type {Touch[]} */
    this.touches = [];
    /** @type {number | null} */
    this.chosen = null;
    /** @type {{ k: number, total_s: number, offset_s: number, edit: ScenarioEdit | null } | null} */
    this.drag = null;
    this.zoom = 1;
    this.total_s = 0;
    this.phases = root.querySelector("[data-phases]");
    this.borderTrack = root.querySelector("[data-borders]");
    this.track = root.querySelector("[data-lanes]");
    const byAttribute = (/** @type {string} */ name) =>
      new Map(
        [...root.querySelectorAll(`[data-${name}]`)].map((node) => [node.getAttribute(`data-${name}`) ?? "", node]),
      );
    this.lanes = byAttribute("lane");
    this.laneNames = byAttribute("lane-name");
    this.phases.addEventListener("click", (event) => {
      const k = this.bars.indexOf(/** @type {any} */ (event.target).closest("button"));
      if (k >= 0) callbacks.onChoosePhase(k);
    });
    this.phases.addEventListener("keydown", (event) => this.onKey(event));
    for (const [effector, lane] of this.lanes) {
      lane.addEventListener("click", (event) => this.onLaneClick(effector, event));
      lane.addEventListener("dblclick", (event) => callbacks.onToggle(this.phaseAt(event), effector));
    }
    root.querySelector("[data-wider]").addEventListener("click", () => this.setZoom(this.zoom * ZOOM_STEP));
    root.querySelector("[data-narrower]").addEventListener("click", () => this.setZoom(this.zoom / ZOOM_STEP));
  }

  /** @param {number} zoom */
  setZoom(zoom) {
    this.zoom = Math.min(Math.max(zoom, 1), MAX_ZOOM);
    this.track.style.width = `${100 * this.zoom}%`;
    this.bars[this.chosen ?? -1]?.scrollIntoView({ inline: "center", block: "nearest" });
  }

  /** @param {KeyboardEvent} event */
  onKey(event) {
    const k = this.bars.indexOf(/** @type {HTMLElement} */ (document.activeElement));
    if (k < 0 || !TARGETS[event.key] || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    const to = Math.min(Math.max(TARGETS[event.key](k, this.bars.length - 1), 0), this.bars.length - 1);
    this.bars[to].focus();
    this.callbacks.onChoosePhase(to);
  }

  /** @param {string} effector @param {MouseEvent} event */
  onLaneClick(effector, event) {
    const k = this.phaseAt(event);
    const touch = this.touches.find(
      (touch) => touch.effector === effector && touch.phases[0] <= k && k <= touch.phases[1],
    );
    if (touch) this.callbacks.onChooseContact(touch.number);
    this.callbacks.onChoosePhase(k);
  }

  /** @param {MouseEvent} event */
  timeAt(event) {
    const box = this.track.getBoundingClientRect();
    return ((event.clientX - box.left) / box.width) * this.total_s;
  }

  /** @param {MouseEvent} event */
  phaseAt(event) {
    const t_s = this.timeAt(event),
      k = phaseEndTimes(this.scenario).findIndex((end_s) => t_s < end_s);
    return k < 0 ? this.scenario.phases.length - 1 : k;
  }

  // Draws the phases of a scenario and its touches. While a border is dragged, the time scale does not change.
  /** @param {Scenario} scenario @param {Touch[]} touches */
  draw(scenario, touches) {
    Object.assign(this, { scenario, touches });
    const ends_s = phaseEndTimes(scenario);
    this.total_s = this.drag?.total_s ?? ends_s[ends_s.length - 1];
    if (this.bars.length !== scenario.phases.length) this.createBars();
    const start_s = (/** @type {number} */ k) => (k > 0 ? ends_s[k - 1] : 0);
    for (const [k, bar] of this.bars.entries()) this.placeNode(bar, start_s(k), ends_s[k]);
    for (const [k, border] of this.borders.entries()) {
      this.placeNode(border, ends_s[k], ends_s[k]);
      border.setAttribute("aria-valuenow", ends_s[k].toFixed(3));
      border.setAttribute(
        "aria-valuetext",
        `${ends_s[k].toFixed(2)} seconds; phase ${k} lasts ${scenario.phases[k].duration_s.toFixed(2)} seconds`,
      );
      border.setAttribute("aria-valuemax", String(this.total_s));
    }
    for (const [effector, lane] of this.lanes) {
      const own = touches.filter((touch) => touch.effector === effector);
      for (const node of [lane, this.laneNames.get(effector)]) node?.classList.toggle("idle", own.length === 0);
      while (lane.children.length < own.length) lane.append(document.createElement("i"));
      while (lane.children.length > own.length) lane.lastElementChild.remove();
      for (const [i, { phases, number, side }] of own.entries()) {
        lane.children[i].className = side;
        lane.children[i].textContent = String(number);
        this.placeNode(/** @type {HTMLElement} */ (lane.children[i]), start_s(phases[0]), ends_s[phases[1]]);
      }
      const intervals = own
        .map(({ phases }) => `${start_s(phases[0]).toFixed(2)} s to ${ends_s[phases[1]].toFixed(2)} s`)
        .join("; ");
      lane.setAttribute(
        "aria-label",
        `${effectorLabel(effector)} touches ${intervals ? `from ${intervals}` : "nothing"}`,
      );
    }
  }

  /** @param {HTMLElement} node @param {number} start_s @param {number} end_s */
  placeNode(node, start_s, end_s) {
    node.style.left = `${(100 * start_s) / this.total_s}%`;
    if (end_s > start_s) node.style.width = `${(100 * (end_s - start_s)) / this.total_s}%`;
  }

  createBars() {
    this.bars = this.scenario.phases.map((/** @type {Phase} */ _, /** @type {number} */ k) =>
      createElement("button", { type: "button", tabIndex: -1 }, createElement("span", {}, String(k))),
    );
    this.phases.replaceChildren(...this.bars);
    this.borders = this.scenario.phases.map((/** @type {Phase} */ _, /** @type {number} */ k) => this.createBorder(k));
    this.borderTrack.replaceChildren(...this.borders);
    this.markChosen();
  }

  /** @param {number} k */
  createBorder(k) {
    const border = createElement("div", {
      role: "slider",
      ariaOrientation: "horizontal",
      ariaLabel: `End of phase ${k}`,
      ariaValueMin: "0",
      tabIndex: -1,
      title: `End of phase ${k}: drag it; with Shift, all later phases shift along`,
    });
    const stop = () => {
      this.drag = null;
      this.draw(this.scenario, this.touches);
    };
    border.addEventListener("pointerdown", (/** @type {PointerEvent} */ event) => {
      if (event.button !== 0) return;
      event.preventDefault();
      border.setPointerCapture(event.pointerId);
      border.focus();
      this.drag = {
        k,
        total_s: this.total_s,
        offset_s: this.timeAt(event) - phaseEndTimes(this.scenario)[k],
        edit: null,
      };
    });
    border.addEventListener("pointermove", (/** @type {PointerEvent} */ event) => {
      if (this.drag?.k !== k) return;
      const to_s = Math.round((this.timeAt(event) - this.drag.offset_s) / FINE_STEP_S) * FINE_STEP_S,
        shiftLater = event.shiftKey;
      this.drag.edit = (/** @type {Scenario} */ scenario) => movePhaseEnd(scenario, k, to_s, shiftLater);
      this.callbacks.onPropose(this.drag.edit);
    });
    border.addEventListener("pointerup", () => {
      const edit = this.drag?.edit;
      stop();
      if (edit) this.callbacks.onCommit(edit, `End of phase ${k} stored.`);
    });
    border.addEventListener("pointercancel", () => {
      stop();
      this.callbacks.onDiscard();
    });
    border.addEventListener("keydown", (/** @type {KeyboardEvent} */ event) => {
      if (event.key === "Escape" && this.drag) {
        stop();
        return this.callbacks.onDiscard();
      }
      if (!DIRECTIONS[event.key] || event.ctrlKey || event.metaKey || event.altKey) return;
      event.preventDefault();
      const to_s =
        phaseEndTimes(this.scenario)[k] + DIRECTIONS[event.key] * (event.shiftKey ? FINE_STEP_S : COARSE_STEP_S);
      this.callbacks.onKeyEdit(
        `end ${k}`,
        (scenario) => movePhaseEnd(scenario, k, to_s, false),
        `End of phase ${k} stored.`,
      );
    });
    return border;
  }

  // Shows the validation of each phase and which phase is chosen. A result for another number of phases is outdated.
  /** @param {PhaseState[]} phases @param {number | null} chosen */
  showValidation(phases, chosen) {
    this.chosen = chosen;
    if (phases.length !== this.bars.length) return;
    for (const [k, bar] of this.bars.entries()) {
      const sentence = phaseSentence(phases[k], k);
      bar.dataset.kind = phases[k].kind;
      bar.title = sentence;
      bar.setAttribute("aria-label", sentence);
    }
    this.markChosen();
  }

  // The chosen phase and its borders can be reached by the Tab key, the others cannot.
  markChosen() {
    for (const [k, bar] of this.bars.entries()) {
      bar.setAttribute("aria-pressed", String(k === this.chosen));
      bar.tabIndex = k === (this.chosen ?? 0) ? 0 : -1;
    }
    for (const [k, border] of this.borders.entries()) {
      const isAdjacent = k === this.chosen || k === (this.chosen ?? NaN) - 1;
      border.tabIndex = isAdjacent && this.chosen !== null ? 0 : -1;
      border.classList.toggle("near", isAdjacent);
    }
  }
}
