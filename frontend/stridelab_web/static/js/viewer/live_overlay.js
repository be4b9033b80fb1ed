// Draws over the scene of a live robot what changes with every frame: forces, CoM, capture point, next foothold, pushes,
// the path that the control has in mind as a ribbon on the ground, and the next footholds as ghosts of soles; and turns a drag from the robot into a push. The scene's camera projects; distances on the canvas are CSS pixels.
import { colour } from "../shared/colours.js";

const RIBBON_M = 0.06;
const FORCE_M_PER_N = 0.0006,
  PUSH_M_PER_NS = 0.008,
  PUSH_S = 0.4, // longer than the push, which would hardly be seen
  GRAB_PX = 70,
  SPEED_PER_M = 0.6, // a drag of a metre changes the velocity of the robot by this much, in m/s
  MAX_SPEED = 1.5;

/** The push of a drag of `drag` metres on a robot of `mass_kg`: along the drag, at most MAX_SPEED.
 * @param {number[]} drag @param {number} mass_kg @returns {number[]} */
export function dragImpulse(drag, mass_kg) {
  const length = Math.hypot(...drag);
  if (!(length > 0)) return [0, 0, 0];
  const size = mass_kg * Math.min(SPEED_PER_M * length, MAX_SPEED);
  return drag.map((part) => (size * part) / length);
}

/** The push of `size` N s towards `direction` as the robot faces by its base, horizontal.
 * @param {string} direction @param {number} size @param {number[]} base pose px, py, pz, qw, qx, qy, qz */
export function directedImpulse(direction, size, base) {
  const [w, x, y, z] = base.slice(3);
  const yaw = Math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z));
  const turn = { ahead: 0, left: Math.PI / 2, back: Math.PI, right: -Math.PI / 2 }[direction] ?? 0;
  return [size * Math.cos(yaw + turn), size * Math.sin(yaw + turn), 0];
}

/** The corners of a sole with half edges `half` at a foothold.
 * @param {{position_m: number[], yaw_rad: number}} foothold @param {number[]} half @returns {number[][]} */
export function soleCorners({ position_m: [x, y, z], yaw_rad }, half) {
  const [c, s] = [Math.cos(yaw_rad), Math.sin(yaw_rad)];
  const signs = [
    [1, 1],
    [-1, 1],
    [-1, -1],
    [1, -1],
  ];
  return signs.map(([a, b]) => [x + a * half[0] * c - b * half[1] * s, y + a * half[0] * s + b * half[1] * c, z]);
}

/** The edges of a ribbon of `width` along a path, at the height `z`: one closed polygon.
 * @param {number[][]} path @param {number} width @param {number} z @returns {number[][]} */
export function ribbonAlong(path, width, z) {
  const left = [],
    right = [];
  for (const [k, [x, y]] of path.entries()) {
    const before = path[Math.max(k - 1, 0)],
      after = path[Math.min(k + 1, path.length - 1)];
    const [dx, dy] = [after[0] - before[0], after[1] - before[1]],
      length = Math.hypot(dx, dy) || 1;
    const [nx, ny] = [(-dy / length) * 0.5 * width, (dx / length) * 0.5 * width];
    left.push([x + nx, y + ny, z]);
    right.unshift([x - nx, y - ny, z]);
  }
  return [...left, ...right];
}

export class LiveOverlay {
  // `send(impulse_ns, linkIndex)` is called at the end of a drag; `shown()` returns what is to be drawn.
  /**
   * @param {HTMLCanvasElement} canvas
   * @param {import("./camera.js").Camera} camera
   * @param {{ send: (impulse_ns: number[], link: number) => void, shown: () => { forces: boolean, balance: boolean, horizon: boolean }, mass: () => number, soles: () => Record<string, number[]> }} options
   */
  constructor(canvas, camera, { send, shown, mass, soles }) {
    this.canvas = canvas;
    this.camera = camera;
    this.send = send;
    this.shown = shown;
    this.mass = mass;
    this.soles = soles;
    /** @type {any} */
    this.frame = null;
    /** @type {any} */
    this.drag = null;
    canvas.addEventListener("pointerdown", (event) => this.grab(event));
    canvas.addEventListener("pointermove", (event) => this.pull(event));
    canvas.addEventListener("pointerup", (event) => this.release(event));
    canvas.addEventListener("pointercancel", () => this.cancel());
  }

  /** @param {boolean} active */
  setActive(active) {
    this.canvas.toggleAttribute("data-active", active);
    this.cancel();
  }

  cancel() {
    this.drag = null;
  }

  // A point of the world in CSS pixels and the depth that `unproject` needs; null behind the camera.
  /** @param {number[]} point @returns {[number, number, number] | null} */
  project(point) {
    const p = this.camera.toViserFrame(point).project(this.camera.viser.camera);
    if (p.z > 1) return null;
    const { clientWidth, clientHeight } = this.canvas;
    return [((p.x + 1) / 2) * clientWidth, ((1 - p.y) / 2) * clientHeight, p.z];
  }

  /** @param {[number, number]} place @param {number} depth */
  unproject([x, y], depth) {
    const { viser } = this.camera,
      { clientWidth, clientHeight } = this.canvas;
    const p = viser.camera.position.clone().set((2 * x) / clientWidth - 1, 1 - (2 * y) / clientHeight, depth);
    const q = viser.nodeRefFromName[""].worldToLocal(p.unproject(viser.camera));
    return [q.x, q.y, q.z];
  }

  /** @param {PointerEvent} event */
  grab(event) {
    if (!this.frame || event.button !== 0) return;
    let nearest = { link: -1, gap: GRAB_PX, at: [0, 0, 0] };
    for (const [link, pose] of this.frame.links.entries()) {
      const at = this.project(pose.slice(0, 3));
      const gap = at ? Math.hypot(at[0] - event.offsetX, at[1] - event.offsetY) : Infinity;
      if (at && gap < nearest.gap) nearest = { link, gap, at };
    }
    if (nearest.link < 0) return;
    this.canvas.setPointerCapture(event.pointerId);
    this.drag = { link: nearest.link, depth: nearest.at[2], to: [event.offsetX, event.offsetY] };
  }

  /** @param {PointerEvent} event */
  pull(event) {
    if (this.drag) this.drag.to = [event.offsetX, event.offsetY];
  }

  /** @param {PointerEvent} event */
  release(event) {
    if (!this.drag) return;
    this.pull(event);
    const impulse = this.draggedImpulse();
    if (Math.hypot(...impulse) > 0.5) this.send(impulse, this.drag.link);
    this.drag = null;
  }

  draggedImpulse() {
    const from = this.frame.links[this.drag.link].slice(0, 3);
    const to = this.unproject(this.drag.to, this.drag.depth);
    return dragImpulse(
      to.map((value, k) => value - from[k]),
      this.mass(),
    );
  }

  draw() {
    const { canvas, frame } = this,
      ratio = window.devicePixelRatio || 1;
    const [width, height] = [canvas.clientWidth, canvas.clientHeight];
    if (canvas.width !== Math.round(width * ratio)) canvas.width = Math.round(width * ratio);
    if (canvas.height !== Math.round(height * ratio)) canvas.height = Math.round(height * ratio);
    const pen = /** @type {CanvasRenderingContext2D} */ (canvas.getContext("2d"));
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.clearRect(0, 0, width, height);
    if (!frame) return;
    pen.lineCap = pen.lineJoin = "round";
    const { forces, balance, horizon } = this.shown();
    if (horizon) this.drawHorizon(pen);
    if (forces)
      for (const { at, force } of frame.arrows) this.arrow(pen, at, force, FORCE_M_PER_N, colour("green"), false);
    if (balance) this.drawBalance(pen);
    this.drawPush(pen);
  }

  /** @param {CanvasRenderingContext2D} pen */
  drawHorizon(pen) {
    const { horizon_m, footholds, ground_m } = this.frame;
    if (horizon_m.length > 1) this.polygon(pen, ribbonAlong(horizon_m, RIBBON_M, ground_m), colour("blue"), 0.35);
    for (const [k, foothold] of footholds.entries()) {
      const half = this.soles()[foothold.effector];
      if (half) this.polygon(pen, soleCorners(foothold, half), colour("purple"), 0.5 / (1 + 0.6 * k));
    }
  }

  // A filled polygon; nothing if a corner is behind the camera.
  /** @param {CanvasRenderingContext2D} pen @param {number[][]} corners @param {string} fill @param {number} opacity */
  polygon(pen, corners, fill, opacity) {
    const places = corners.map((corner) => this.project(corner));
    if (places.some((place) => !place)) return;
    pen.beginPath();
    for (const place of places) if (place) pen.lineTo(place[0], place[1]);
    pen.closePath();
    pen.globalAlpha = opacity;
    pen.fillStyle = fill;
    pen.fill();
    pen.globalAlpha = 1;
    pen.strokeStyle = fill;
    pen.lineWidth = 1.5;
    pen.stroke();
  }

  /** @param {CanvasRenderingContext2D} pen */
  drawBalance(pen) {
    const { com_m, capture_m, foothold_m, ground_m } = this.frame;
    const com = this.project(com_m),
      capture = this.project([...capture_m, ground_m]);
    if (com) this.dot(pen, com, 6, colour("blue"));
    if (capture) this.cross(pen, capture, colour("orange-bright"));
    const ring = foothold_m && this.project(foothold_m);
    if (ring) {
      pen.beginPath();
      pen.ellipse(ring[0], ring[1], 14, 8, 0, 0, 2 * Math.PI);
      pen.strokeStyle = colour("purple");
      pen.lineWidth = 3;
      pen.stroke();
    }
  }

  /** @param {CanvasRenderingContext2D} pen */
  drawPush(pen) {
    const { push, links } = this.frame;
    if (push && push.link !== null && push.since_s < PUSH_S)
      this.arrow(pen, links[push.link].slice(0, 3), push.impulse_ns, PUSH_M_PER_NS, colour("red"), true);
    if (!this.drag) return;
    const from = this.project(links[this.drag.link].slice(0, 3)),
      impulse = Math.hypot(...this.draggedImpulse());
    if (!from) return;
    this.line(pen, from, this.drag.to, colour("red"), 4);
    pen.fillStyle = colour("ink");
    pen.font = "600 14px system-ui, sans-serif";
    pen.fillText(
      `${impulse.toFixed(0)} N s (${(impulse / this.mass()).toFixed(2)} m/s)`,
      this.drag.to[0] + 12,
      this.drag.to[1] - 12,
    );
  }

  // An arrow from `at` along `force`; with `into` it ends there, as a push does.
  /**
   * @param {CanvasRenderingContext2D} pen
   * @param {number[]} at
   * @param {number[]} force
   * @param {number} scale
   * @param {string} edge
   * @param {boolean} into
   */
  arrow(pen, at, force, scale, edge, into) {
    const far = at.map((value, k) => value + (into ? -1 : 1) * scale * force[k]);
    const a = this.project(into ? far : at),
      b = this.project(into ? at : far);
    if (a && b) this.line(pen, a, b, edge, into ? 5 : 3);
  }

  /**
   * @param {CanvasRenderingContext2D} pen
   * @param {number[]} from
   * @param {number[]} to
   * @param {string} edge
   * @param {number} width
   */
  line(pen, from, to, edge, width) {
    const [ax, ay] = from,
      [bx, by] = to;
    const angle = Math.atan2(by - ay, bx - ax),
      head = 4 + 2 * width;
    pen.strokeStyle = edge;
    pen.lineWidth = width;
    pen.beginPath();
    pen.moveTo(ax, ay);
    pen.lineTo(bx, by);
    for (const side of [-0.45, 0.45]) {
      pen.moveTo(bx, by);
      pen.lineTo(bx - head * Math.cos(angle + side), by - head * Math.sin(angle + side));
    }
    pen.stroke();
  }

  /** @param {CanvasRenderingContext2D} pen @param {number[]} at @param {number} radius @param {string} fill */
  dot(pen, at, radius, fill) {
    const [x, y] = at;
    pen.beginPath();
    pen.arc(x, y, radius, 0, 2 * Math.PI);
    pen.fillStyle = fill;
    pen.fill();
  }

  /** @param {CanvasRenderingContext2D} pen @param {number[]} at @param {string} edge */
  cross(pen, at, edge) {
    const [x, y] = at;
    pen.strokeStyle = edge;
    pen.lineWidth = 3;
    pen.beginPath();
    for (const side of [-1, 1]) {
      pen.moveTo(x - 7, y - 7 * side);
      pen.lineTo(x + 7, y + 7 * side);
    }
    pen.stroke();
  }
}
