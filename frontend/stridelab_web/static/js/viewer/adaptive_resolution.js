// Adapts the pixel ratio of the scene: that of the screen at rest, a smaller one while frames take long.
//
// viser lowers its pixel ratio itself, by a quarter at most and not below two frames per second. Its development setting
// `fixedDpr` replaces that by the ratio set here.

const STEPS = [1, 0.75, 0.5],
  MIN_RATIO = 0.5; // parts of the screen's ratio; device pixels per CSS pixel
const SLOW_MS = 50,
  FAST_MS = 33,
  MAX_INTERVAL_MS = 3000,
  FRAMES = 5,
  MAX_TOTAL_MS = 700,
  IDLE_MS = 400;

// The pixel ratios for a screen with `ratio` device pixels per CSS pixel, the finest first.
/** @param {number} ratio */
export function pixelRatios(ratio) {
  const lowest = Math.min(ratio, MIN_RATIO);
  return [...new Set(STEPS.map((step) => Math.max(ratio * step, lowest)))];
}

// The index of the next ratio after frames that took `taken_ms` each at ratio `k`. The time is taken as proportional to the
// number of pixels: slow frames get the finest ratio that is not slow, fast ones the next finer one if it stays fast.
/** @param {number[]} ratios @param {number} k @param {number} taken_ms */
export function nextLevel(ratios, k, taken_ms) {
  const expected_ms = (/** @type {number} */ level) => taken_ms * (ratios[level] / ratios[k]) ** 2;
  if (taken_ms > SLOW_MS) {
    const coarser = ratios.findIndex((_, level) => level > k && expected_ms(level) <= SLOW_MS);
    return coarser < 0 ? ratios.length - 1 : coarser;
  }
  return k > 0 && expected_ms(k - 1) < FAST_MS ? k - 1 : k;
}

export class AdaptiveResolution {
  // `isPlaying()` returns whether the page draws continuously.
  /** @param {import("./viser_nodes.js").ViserNodes} nodes */
  constructor(nodes, isPlaying = () => false) {
    this.nodes = nodes;
    this.isPlaying = isPlaying;
    this.level = 0;
    /** @type {number[]} */
    this.ratios = [];
    this.last_ms = -Infinity;
    this.moved_ms = -Infinity;
    this.typical_ms = 0;
    /** @type {number[]} */
    this.taken_ms = [];
    this.wasBusy = false;
    this.idleTimer = 0;
    const store = nodes.viser.root,
      inside = nodes.frame.contentWindow;
    this.settings = nodes.context.useDevSettings;
    // Subscribes to frames as a component of the scene does.
    store.getState().internal.subscribe({ current: () => this.onFrame(performance.now()) }, 0, store);
    const onMove = (/** @type {PointerEvent | WheelEvent} */ event) => {
      if (event.buttons || event.type === "wheel") this.moved_ms = performance.now();
    };
    for (const target of [inside, window])
      target.addEventListener("pointermove", onMove, { capture: true, passive: true });
    inside.addEventListener("wheel", onMove, { capture: true, passive: true });
    this.watchScreen();
  }

  // Follows the ratio of the screen, which changes with the screen of the window and with the zoom.
  watchScreen() {
    this.ratios = pixelRatios(devicePixelRatio);
    this.level = Math.min(this.level, this.ratios.length - 1);
    this.setLevel(0);
    matchMedia(`(resolution: ${devicePixelRatio}dppx)`).addEventListener("change", () => this.watchScreen(), {
      once: true,
    });
  }

  // Whether frames follow one another at once, so that the interval between two is the time that one takes.
  get isBusy() {
    return this.isPlaying() || performance.now() - this.moved_ms < this.patience_ms;
  }

  // Slow frames also delay pointer events.
  get patience_ms() {
    return Math.max(IDLE_MS, 2 * this.typical_ms);
  }

  /** @param {number} now_ms */
  onFrame(now_ms) {
    const gap_ms = now_ms - this.last_ms,
      { isBusy, wasBusy } = this;
    Object.assign(this, { last_ms: now_ms, wasBusy: isBusy });
    if (!isBusy) return;
    this.waitForIdle();
    if (wasBusy && gap_ms < MAX_INTERVAL_MS) this.taken_ms.push(gap_ms);
    const n = this.taken_ms.length,
      sum_ms = this.taken_ms.reduce((sum, ms) => sum + ms, 0);
    if (n >= FRAMES || (n > 1 && sum_ms > MAX_TOTAL_MS)) {
      this.typical_ms = this.taken_ms.sort((a, b) => a - b)[(n - 1) >> 1];
      this.taken_ms = [];
      this.level = nextLevel(this.ratios, this.level, this.typical_ms);
    }
    this.setLevel(this.level);
  }

  waitForIdle() {
    clearTimeout(this.idleTimer);
    this.idleTimer = setTimeout(() => {
      if (this.isBusy) return this.waitForIdle();
      this.taken_ms = [];
      this.setLevel(0);
    }, this.patience_ms);
  }

  /** @param {number} level */
  setLevel(level) {
    this.settings.set({ fixedDpr: this.ratios[level] });
  }
}
