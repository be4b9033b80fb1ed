// The range of the timeline that is looped: two handles over a bar, moved by pointer and keys.

import { translate } from "../shared/translate.js";

/** @type {("from" | "to")[]} */
const ENDS = ["from", "to"];
/** @type {Record<string, number>} */
const KEY_STEPS = { ArrowLeft: -1, ArrowDown: -1, ArrowRight: 1, ArrowUp: 1, PageDown: -10, PageUp: 10 };

export class LoopRange {
  // Calls `onChange()` for a new range; frames count from 0.
  /** @param {PageElement} row @param {() => void} onChange */
  constructor(row, onChange) {
    this.row = row;
    this.onChange = onChange;
    /** @type {number[]} */
    this.time_s = [0];
    this.from = 0;
    this.to = 0;
    this.fill = row.querySelector("[data-within]");
    this.handles = ENDS.map((end) => row.querySelector(`[data-end=${end}]`));
    for (const [k, handle] of this.handles.entries()) {
      const end = ENDS[k];
      handle.addEventListener("pointerdown", (event) => {
        if (event.button !== 0) return;
        event.preventDefault();
        handle.setPointerCapture(event.pointerId);
        handle.focus();
      });
      handle.addEventListener(
        "pointermove",
        (event) => handle.hasPointerCapture(event.pointerId) && this.moveEnd(end, this.frameAt(event)),
      );
      handle.addEventListener("keydown", (event) => this.onKey(event, end));
    }
  }

  // Sets the times of the frames, and the range in seconds; NaN for its default ends.
  /** @param {number[]} time_s @param {number} from_s @param {number} to_s */
  setFrames(time_s, from_s, to_s) {
    this.time_s = time_s;
    const last = time_s.length - 1;
    const frame = (/** @type {number} */ t_s, /** @type {number} */ fallback) =>
      Number.isFinite(t_s)
        ? Math.max(
            time_s.findLastIndex((each) => each <= t_s + 1e-6),
            0,
          )
        : fallback;
    this.from = frame(from_s, 0);
    this.to = Math.min(Math.max(frame(to_s, last), this.from + 1), last);
    for (const handle of this.handles) handle.setAttribute("aria-valuemax", String(last));
    this.draw();
  }

  get end_s() {
    return this.time_s[this.time_s.length - 1];
  }

  get isWhole() {
    return this.from === 0 && this.to === this.time_s.length - 1;
  }

  // The frame to play next: wraps from the end of the range to its start.
  /** @param {number} frame */
  wrapFrame(frame) {
    return frame > this.to
      ? this.from + ((frame - this.from) % (this.to - this.from))
      : frame < this.from
        ? this.from
        : frame;
  }

  /** @param {"from" | "to"} end @param {number} frame */
  moveEnd(end, frame) {
    const last = this.time_s.length - 1;
    if (end === "from") this.from = Math.min(Math.max(frame, 0), this.to - 1);
    else this.to = Math.max(Math.min(frame, last), this.from + 1);
    this.draw();
    this.onChange();
  }

  // Starts or ends the range at a frame; an end on the wrong side of it moves to the end of the timeline.
  /** @param {"from" | "to"} end @param {number} frame */
  setEnd(end, frame) {
    const last = this.time_s.length - 1;
    if (end === "from" && frame >= this.to) this.to = last;
    if (end === "to" && frame <= this.from) this.from = 0;
    this.moveEnd(end, frame);
  }

  reset() {
    [this.from, this.to] = [0, this.time_s.length - 1];
    this.draw();
    this.onChange();
  }

  /** @param {PointerEvent} event */
  frameAt(event) {
    const box = this.row.getBoundingClientRect(),
      t_s = ((event.clientX - box.left) / box.width) * this.end_s;
    const after = this.time_s.findIndex((each) => each >= t_s);
    return after < 0 ? this.time_s.length - 1 : after;
  }

  /** @param {KeyboardEvent} event @param {"from" | "to"} end */
  onKey(event, end) {
    const last = this.time_s.length - 1;
    /** @type {Record<string, number>} */
    const ends = { Home: 0, End: last };
    const to = ends[event.key] ?? (KEY_STEPS[event.key] === undefined ? undefined : this[end] + KEY_STEPS[event.key]);
    if (to === undefined || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    event.stopPropagation();
    this.moveEnd(end, to);
  }

  draw() {
    const [a, b] = [this.from, this.to].map((frame) => (100 * this.time_s[frame]) / this.end_s);
    for (const [k, handle] of this.handles.entries()) {
      const frame = this[ENDS[k]];
      handle.style.left = `${(100 * this.time_s[frame]) / this.end_s}%`;
      handle.setAttribute("aria-valuenow", String(frame));
      handle.setAttribute(
        "aria-valuetext",
        translate("%(time)s seconds, frame %(frame)s", { time: this.time_s[frame].toFixed(3), frame: frame + 1 }),
      );
    }
    this.fill.style.left = `${a}%`;
    this.fill.style.width = `${b - a}%`;
  }
}
