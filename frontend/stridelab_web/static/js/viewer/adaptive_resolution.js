// How many pixels the scene is drawn with: those of the screen at rest, fewer while pictures come slowly.
//
// viser lowers its pixel ratio by itself, by a quarter at most and never below two pictures per second. Its development
// setting `fixedDpr` switches that off, and takes the ratio that is found here instead.
const STEPS = [1, 0.75, 0.5],
  LEAST = 0.75; // parts of the screen's ratio; device pixels per CSS pixel
const SLOW_MS = 50,
  FAST_MS = 33,
  LONGEST_MS = 3000,
  PICTURES = 5,
  ENOUGH_MS = 700,
  REST_MS = 400;

// The ratios to draw with on a screen of `ratio` device pixels per CSS pixel, the finest first.
export function ratios(ratio) {
  const least = Math.min(ratio, LEAST);
  return [...new Set(STEPS.map((step) => Math.max(ratio * step, least)))];
}

// Which of `all` ratios to go on with after pictures that took `taken_ms` each with the one at `k`. The time goes with the
// number of pixels: slow pictures get the finest ratio that would not be slow, fast ones the next finer one if that stays fast.
export function next(all, k, taken_ms) {
  const expected_ms = (at) => taken_ms * (all[at] / all[k]) ** 2;
  if (taken_ms > SLOW_MS) {
    const better = all.findIndex((_, at) => at > k && expected_ms(at) <= SLOW_MS);
    return better < 0 ? all.length - 1 : better;
  }
  return k > 0 && expected_ms(k - 1) < FAST_MS ? k - 1 : k;
}

export class Pixels {
  // `playing()` tells whether the page asks for picture after picture.
  constructor(nodes, playing = () => false) {
    this.nodes = nodes;
    this.playing = playing;
    this.level = 0;
    /** @type {number[]} */
    this.all = [];
    this.last_ms = -Infinity;
    this.moved_ms = -Infinity;
    this.typical_ms = 0;
    this.taken_ms = [];
    this.was = false;
    this.rest = 0;
    const store = nodes.viser.scene.__r3f.root,
      inside = nodes.frame.contentWindow;
    this.settings = nodes.context.useDevSettings;
    // As a component of the scene hears of each picture.
    store.getState().internal.subscribe({ current: () => this.drawn(performance.now()) }, 0, store);
    const moved = (event) => {
      if (event.buttons || event.type === "wheel") this.moved_ms = performance.now();
    };
    for (const target of [inside, window])
      target.addEventListener("pointermove", moved, { capture: true, passive: true });
    inside.addEventListener("wheel", moved, { capture: true, passive: true });
    this.watch();
  }

  // A window on another screen, or of another zoom, has another ratio.
  watch() {
    this.all = ratios(devicePixelRatio);
    this.level = Math.min(this.level, this.all.length - 1);
    this.put(0);
    matchMedia(`(resolution: ${devicePixelRatio}dppx)`).addEventListener("change", () => this.watch(), { once: true });
  }

  // Whether each picture is followed by the next one: a gap between two is then the time that one takes.
  get busy() {
    return this.playing() || performance.now() - this.moved_ms < this.patience_ms;
  }

  // A slow picture keeps events of the pointer waiting, too.
  get patience_ms() {
    return Math.max(REST_MS, 2 * this.typical_ms);
  }

  drawn(now_ms) {
    const gap_ms = now_ms - this.last_ms,
      { busy, was } = this;
    Object.assign(this, { last_ms: now_ms, was: busy });
    if (!busy) return;
    this.waitForRest();
    if (was && gap_ms < LONGEST_MS) this.taken_ms.push(gap_ms);
    const n = this.taken_ms.length,
      sum_ms = this.taken_ms.reduce((sum, ms) => sum + ms, 0);
    if (n >= PICTURES || (n > 1 && sum_ms > ENOUGH_MS)) {
      this.typical_ms = this.taken_ms.sort((a, b) => a - b)[(n - 1) >> 1];
      this.taken_ms = [];
      this.level = next(this.all, this.level, this.typical_ms);
    }
    this.put(this.level);
  }

  waitForRest() {
    clearTimeout(this.rest);
    this.rest = setTimeout(() => {
      if (this.busy) return this.waitForRest();
      this.taken_ms = [];
      this.put(0);
    }, this.patience_ms);
  }

  put(level) {
    this.settings.set({ fixedDpr: this.all[level] });
  }
}
