// Steers a live robot: a stick for the pointer, and the arrow keys of the page while they are held.
const REPEAT_MS = 200; // the robot stops a second after the last command

export const LIMITS = { ahead_m_s: 0.4, left_m_s: 0.2, turn_rad_s: 0.5 };

/** @type {Record<string, number[]>} */
const DIRECTIONS = { ArrowUp: [0, 1], ArrowDown: [0, -1], ArrowLeft: [-1, 0], ArrowRight: [1, 0] };

/** The command of a stick at `x` to the right and `y` ahead, both within the unit circle.
 * @param {number} x @param {number} y @param {boolean} sideways step sideways in place of turning */
export function stickCommand(x, y, sideways) {
  const scale = 1 / Math.max(1, Math.hypot(x, y));
  const aside = x ? -x * scale : 0; // no negative zero
  return {
    ahead_m_s: LIMITS.ahead_m_s * y * scale,
    left_m_s: sideways ? LIMITS.left_m_s * aside : 0,
    turn_rad_s: sideways ? 0 : LIMITS.turn_rad_s * aside,
  };
}

/** The stick's place for the keys that are held; each axis is fully used.
 * @param {Iterable<string>} keys @returns {[number, number]} */
export function placeOfKeys(keys) {
  let [x, y] = [0, 0];
  for (const key of keys) {
    const [dx, dy] = DIRECTIONS[key] ?? [0, 0];
    x += dx;
    y += dy;
  }
  return [x, y];
}

export class Steering {
  // `send(command)` is called while the robot is steered and once when it is let go; `isOn()` whether keys steer.
  /**
   * @param {PageElement} stick
   * @param {{ send: (command: object) => void, isOn: () => boolean, isSideways: () => boolean }} options
   */
  constructor(stick, { send, isOn, isSideways }) {
    this.stick = stick;
    this.knob = stick.querySelector("[data-knob]");
    this.send = send;
    this.isOn = isOn;
    this.isSideways = isSideways;
    this.keys = new Set();
    this.shifted = false;
    /** @type {[number, number]} */
    this.place = [0, 0];
    this.timer = 0;
    stick.addEventListener("pointerdown", (event) => this.grab(event));
    stick.addEventListener("pointermove", (event) => this.pull(event));
    for (const end of ["pointerup", "pointercancel"]) stick.addEventListener(end, () => this.move(0, 0));
    document.addEventListener("keydown", (event) => this.press(event));
    document.addEventListener("keyup", (event) => this.release(event));
    window.addEventListener("blur", () => this.letGo());
  }

  /** @param {PointerEvent} event */
  grab(event) {
    if (this.stick.closest("fieldset").disabled) return;
    this.stick.setPointerCapture(event.pointerId);
    this.follow(event);
  }

  /** @param {PointerEvent} event */
  pull(event) {
    if (this.stick.hasPointerCapture(event.pointerId)) this.follow(event);
  }

  /** @param {PointerEvent} event */
  follow(event) {
    const { left, top, width, height } = this.stick.getBoundingClientRect();
    const x = (2 * (event.clientX - left)) / width - 1,
      y = 1 - (2 * (event.clientY - top)) / height;
    const scale = 1 / Math.max(1, Math.hypot(x, y));
    this.move(x * scale, y * scale);
  }

  /** @param {KeyboardEvent} event */
  press(event) {
    if (
      !(event.key in DIRECTIONS) ||
      !this.isOn() ||
      /** @type {Element} */ (event.target).matches?.("input:not([type=checkbox]), select, textarea")
    )
      return;
    if (document.querySelector("dialog[open]") || this.stick.closest("fieldset").disabled) return;
    event.preventDefault();
    this.shifted = event.shiftKey;
    this.keys.add(event.key);
    this.move(...placeOfKeys(this.keys));
  }

  /** @param {KeyboardEvent} event */
  release(event) {
    if (this.keys.delete(event.key)) this.move(...placeOfKeys(this.keys));
  }

  letGo() {
    this.keys.clear();
    this.move(0, 0);
  }

  /** @param {number} x @param {number} y */
  move(x, y) {
    const wasHeld = this.place.some(Boolean);
    this.place = [x, y];
    this.knob.style.translate = `${38 * x}px ${-38 * y}px`;
    if (!wasHeld && !x && !y) return;
    this.repeat();
  }

  // Sends the command now, and again while the stick is held.
  repeat() {
    clearTimeout(this.timer);
    this.send({ type: "steer", ...stickCommand(...this.place, this.isSideways() || this.shifted) });
    if (this.place.some(Boolean)) this.timer = setTimeout(() => this.repeat(), REPEAT_MS);
    else this.shifted = false;
  }
}
