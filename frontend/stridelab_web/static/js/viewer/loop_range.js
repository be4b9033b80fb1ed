// The part of the timeline that is played again and again: two handles over a bar, by mouse and by keys.

const STEPS = { ArrowLeft: -1, ArrowDown: -1, ArrowRight: 1, ArrowUp: 1, PageDown: -10, PageUp: 10 };

export class LoopRange {
  // `change()` hears of a new range; frames count from 0.
  constructor(row, change) {
    this.row = row;
    this.change = change;
    /** @type {number[]} */
    this.time_s = [0];
    this.from = 0;
    this.to = 0;
    this.shade = row.querySelector("[data-within]");
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
        (event) => handle.hasPointerCapture(event.pointerId) && this.put(end, this.frameAt(event)),
      );
      handle.addEventListener("keydown", (event) => this.onKey(event, end));
    }
  }

  // The instants of the frames, and the range in seconds that was asked for, if any.
  begin(time_s, from_s, to_s) {
    this.time_s = time_s;
    const last = time_s.length - 1;
    const frame = (t_s, other) =>
      Number.isFinite(t_s)
        ? Math.max(
            time_s.findLastIndex((each) => each <= t_s + 1e-6),
            0,
          )
        : other;
    this.from = frame(from_s, 0);
    this.to = Math.min(Math.max(frame(to_s, last), this.from + 1), last);
    for (const handle of this.handles) handle.setAttribute("aria-valuemax", String(last));
    this.draw();
  }

  get end_s() {
    return this.time_s[this.time_s.length - 1];
  }

  get whole() {
    return this.from === 0 && this.to === this.time_s.length - 1;
  }

  // Where a playing frame goes on: back to the beginning of the range from its end.
  wrapped(at) {
    return at > this.to ? this.from + ((at - this.from) % (this.to - this.from)) : at < this.from ? this.from : at;
  }

  put(end, frame) {
    const last = this.time_s.length - 1;
    if (end === "from") this.from = Math.min(Math.max(frame, 0), this.to - 1);
    else this.to = Math.max(Math.min(frame, last), this.from + 1);
    this.draw();
    this.change();
  }

  // The range begins, or ends, at a frame; the other end moves away where it would be behind it.
  set(end, frame) {
    const last = this.time_s.length - 1;
    if (end === "from" && frame >= this.to) this.to = last;
    if (end === "to" && frame <= this.from) this.from = 0;
    this.put(end, frame);
  }

  clear() {
    [this.from, this.to] = [0, this.time_s.length - 1];
    this.draw();
    this.change();
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
      { Home: 0, End: last }[event.key] ?? (STEPS[event.key] === undefined ? undefined : this[end] + STEPS[event.key]);
    if (to === undefined || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    event.stopPropagation();
    this.put(end, to);
  }

  draw() {
    const [a, b] = [this.from, this.to].map((frame) => (100 * this.time_s[frame]) / this.end_s);
    for (const [handle, at] of [
      [this.handles[0], this.from],
      [this.handles[1], this.to],
    ]) {
      handle.style.left = `${(100 * this.time_s[at]) / this.end_s}%`;
      handle.setAttribute("aria-valuenow", String(at));
      handle.setAttribute("aria-valuetext", `${this.time_s[at].toFixed(3)} seconds, frame ${at + 1}`);
    }
    this.shade.style.left = `${a}%`;
    this.shade.style.width = `${b - a}%`;
  }
}
