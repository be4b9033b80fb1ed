// The range of the timeline that is looped: two handles over a bar, moved by pointer and keys.

import { translate } from "../shared/translate.js";

const KEY_STEPS = { ArrowLeft: -1, ArrowDown: -1, ArrowRight: 1, ArrowUp: 1, PageDown: -10, PageUp: 10 };

export class LoopRange {
  // Calls `onChange()` for a new range; frames count from 0.
  constructor(row, onChange) {
    this.row = row;
    this.onChange = onChange;
    /** @type {number[]} */
    this.time_s = [0];
    this.from = 0;
    this.to = 0;
    this.fill = row.querySelector("[data-within]");
    this.handles = ["from", "to"].map((end) => row.querySelector(`[data-end=${end}]`));
    for (const handle of this.handles) {
      const { end } = handle.dataset;
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
  setFrames(time_s, from_s, to_s) {
    this.time_s = time_s;
    const last = time_s.length - 1;
    const frame = (t_s, fallback) =>
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
  wrapFrame(frame) {
    return frame > this.to
      ? this.from + ((frame - this.from) % (this.to - this.from))
      : frame < this.from
        ? this.from
        : frame;
  }

  moveEnd(end, frame) {
    const last = this.time_s.length - 1;
    if (end === "from") this.from = Math.min(Math.max(frame, 0), this.to - 1);
    else this.to = Math.max(Math.min(frame, last), this.from + 1);
    this.draw();
    this.onChange();
  }

  // Starts or ends the range at a frame; an end on the wrong side of it moves to the end of the timeline.
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

  frameAt(event) {
    const box = this.row.getBoundingClientRect(),
      t_s = ((event.clientX - box.left) / box.width) * this.end_s;
    const after = this.time_s.findIndex((each) => each >= t_s);
    return after < 0 ? this.time_s.length - 1 : after;
  }

  onKey(event, end) {
    const last = this.time_s.length - 1;
    const to =
      { Home: 0, End: last }[event.key] ??
      (KEY_STEPS[event.key] === undefined ? undefined : this[end] + KEY_STEPS[event.key]);
    if (to === undefined || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    event.stopPropagation();
    this.moveEnd(end, to);
  }

  draw() {
    const [a, b] = [this.from, this.to].map((frame) => (100 * this.time_s[frame]) / this.end_s);
    for (const [handle, frame] of [
      [this.handles[0], this.from],
      [this.handles[1], this.to],
    ]) {
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
