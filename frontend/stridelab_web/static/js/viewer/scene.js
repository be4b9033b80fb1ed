// Draws one instant of the decoded frames: points, bodies, sticks, arrows, ellipsoids, hoops, and nodes that exist for a
// span of time.
import { cubicHermiteWeights } from "./interpolation.js";
import { MergedColours } from "./merged_colours.js";
import { MeshCopies } from "./mesh_copies.js";
import { HIDDEN, ViserNodes } from "./viser_nodes.js";
import { rotationFromZ } from "./quaternions.js";

const arrowNodes = (/** @type {FrameLayout} */ layout) => layout.arrows.flatMap((arrow) => [arrow[0], arrow[1]]);
const COM_NODES = ["/com/plan", "/com/plan/light"]; // the two halves of the CoM ball (viewer/plan_scene.py)
const INSIDE = ["/cones/", "/com/", "/inputs/", "/axis/"];
// A person without joint centres has lines in place of limbs (scene/recording_frames.py).
const isLimb = (/** @type {string} */ name) => /^\/body\/(?!line)/.test(name);

export class Scene {
  /** @param {PageElement} frame @param {FrameLayout} layout @param {ArrayLike<number>} values */
  constructor(frame, layout, values) {
    this.layout = layout;
    this.values = values;
    // Nodes inside of a body, which are drawn in front of it while `seeThrough`.
    const names = [...layout.points, ...layout.sticks, ...layout.ellipsoids].map(([name]) => name);
    const within = [
      ...names.filter((name) => INSIDE.some((start) => name.startsWith(start))),
      ...arrowNodes(layout),
      ...layout.still.filter((name) => name.startsWith("/paths/")),
      ...(layout.bodies.length ? COM_NODES : []),
    ];
    this.interiorNodes = layout.bodies.length || names.some(isLimb) ? within : [];
    this.seeThrough = true;
    this.magnification = 1;
    this.row = new Float64Array(layout.width);
    this.merged = new MergedColours(layout.bodies.map(([name]) => name));
    this.copies = new MeshCopies(layout.copies);
    this.nodes = new ViserNodes(frame, [
      ...layout.points.map(([name]) => name),
      ...layout.bodies.map(([name]) => name),
      ...layout.sticks.map(([name]) => name),
      ...arrowNodes(layout),
      ...layout.ellipsoids.map(([name]) => name),
      ...layout.hoops.map(([name]) => name),
      ...layout.spans.map(([name]) => name),
      ...this.interiorNodes,
    ]);
  }

  // Points, lines and arrows, which are lightened in dark mode, without the CoM ball, which has a light half.
  get tintedNodes() {
    const { points, sticks, still } = this.layout;
    const names = [
      ...points.map(([name]) => name),
      ...sticks.map(([name]) => name),
      ...arrowNodes(this.layout),
      ...still,
    ];
    return names.filter((name) => !COM_NODES.includes(name) && !name.startsWith("/cones/"));
  }

  /** @param {string[]} prefixes */
  hideGroups(prefixes) {
    this.nodes.hidden = new Set(prefixes);
  }

  // Draws frame `at`, a real number: between two frames, positions and orientations are interpolated.
  /** @param {number} at */
  show(at) {
    this.nodes.refreshClient();
    this.merged.update(this.nodes.viser.nodeRefFromName);
    this.copies.update(this.nodes.viser.nodeRefFromName);
    this.interpolate(at);
    for (const [name, k] of this.layout.points) this.placeNode(name, k, null, 1);
    for (const [name, k] of this.layout.bodies) this.placeNode(name, k, this.quaternionAt(k), 1);
    for (const [name, a, b] of this.layout.sticks) this.drawStick(name, a, b);
    for (const [shaft, head, k] of this.layout.arrows) this.drawArrow(shaft, head, k);
    for (const [name, k, axes] of this.layout.ellipsoids) this.drawEllipsoid(name, k, axes);
    for (const [name, k, size] of this.layout.hoops) this.drawHoop(name, k, size);
    // Before the spans: nodes that are shown for some time are below nodes that stand still.
    for (const name of this.layout.still) this.nodes.setScale(name, 1);
    const t_s = this.timeAt(at);
    for (const [name, start_s, end_s] of this.layout.spans) {
      this.nodes.setScale(name, start_s <= t_s && t_s <= end_s ? 1 : HIDDEN);
    }
    for (const [k, name] of this.interiorNodes.entries()) this.nodes.drawInFront(name, this.seeThrough ? k + 1 : 0);
    this.nodes.draw();
  }

  // The two frames around `at`, and the fraction of the interval between them.
  /** @param {number} at */
  bracket(at) {
    const last = this.layout.n_frames - 1;
    const low = Math.min(Math.max(Math.floor(at), 0), last);
    return [low, Math.min(low + 1, last), at - low];
  }

  /** @param {number} at */
  timeAt(at) {
    const [low, high, fraction] = this.bracket(at);
    return (1 - fraction) * this.layout.time_s[low] + fraction * this.layout.time_s[high];
  }

  /** @param {number} at */
  interpolate(at) {
    const { width, bodies, time_s } = this.layout;
    const [low, high, fraction] = this.bracket(at);
    for (let k = 0; k < width; k += 1) {
      const a = this.values[low * width + k],
        b = this.values[high * width + k];
      this.row[k] = fraction === 0 ? a : (1 - fraction) * a + fraction * b;
    }
    const weights = fraction > 0 && bodies.length ? cubicHermiteWeights(time_s, low, fraction) : null;
    for (const [, k] of bodies) if (weights) this.interpolatePose(k, low, weights);
  }

  // Beside a frame without the body, the linear interpolation stays.
  /** @param {number} from @param {number} low @param {number[]} weights */
  interpolatePose(from, low, weights) {
    const { width } = this.layout;
    for (let k = from; k < from + 7; k += 1) {
      let sum = 0;
      for (const [i, weight] of weights.entries())
        if (weight !== 0) sum += weight * this.values[(low - 1 + i) * width + k];
      if (Number.isFinite(sum)) this.row[k] = sum;
    }
  }

  // The unit quaternion of the body at column k; its sign does not change between frames.
  /** @param {number} k */
  quaternionAt(k) {
    const wxyz = [0, 1, 2, 3].map((i) => this.row[k + 3 + i]),
      norm = Math.hypot(...wxyz);
    return wxyz.map((v) => v / norm);
  }

  /** @param {string} name @param {number} k @param {number[] | null} wxyz @param {number} length */
  placeNode(name, k, wxyz, length) {
    const [x, y, z] = [this.row[k], this.row[k + 1], this.row[k + 2]];
    const visible = Number.isFinite(x + y + z);
    if (visible) this.nodes.setPose(name, [x, y, z], wxyz);
    const thickness = visible ? 1 : HIDDEN;
    this.nodes.setScale(name, thickness, thickness, visible ? length : HIDDEN);
  }

  // A unit ball scaled to semi-axes along x, y and z, times the magnification.
  /** @param {string} name @param {number} k @param {number} axes */
  drawEllipsoid(name, k, axes) {
    this.placeNode(name, k, null, 1);
    const axes_m = [this.row[axes], this.row[axes + 1], this.row[axes + 2]];
    const visible = Number.isFinite(
      this.row[k] + this.row[k + 1] + this.row[k + 2] + axes_m[0] + axes_m[1] + axes_m[2],
    );
    const [x, y, z] = axes_m.map((length) => (visible ? Math.max(this.magnification * length, HIDDEN) : HIDDEN));
    this.nodes.setScale(name, x, y, z);
  }

  // A node of unit size with a pose, scaled by the number in column `size`.
  /** @param {string} name @param {number} k @param {number} size */
  drawHoop(name, k, size) {
    this.placeNode(name, k, this.quaternionAt(k), 1);
    if (Number.isFinite(this.row[k] + this.row[size])) this.nodes.setScale(name, this.row[size]);
  }

  /** @param {string} name @param {number} a @param {number} b */
  drawStick(name, a, b) {
    const d = [0, 1, 2].map((i) => this.row[b + i] - this.row[a + i]);
    const length = Math.hypot(...d);
    if (!(length > 1e-6)) this.nodes.setScale(name, HIDDEN);
    else this.placeNode(name, a, rotationFromZ(d, length), length);
  }

  // A force shorter than the head of its arrow is drawn as a smaller head.
  /** @param {string} shaft @param {string} head @param {number} k */
  drawArrow(shaft, head, k) {
    const { arrow_m_per_n, head_m } = this.layout;
    const force = [this.row[k + 3], this.row[k + 4], this.row[k + 5]];
    const norm = Math.hypot(...force);
    const length = norm * arrow_m_per_n;
    const origin = [this.row[k], this.row[k + 1], this.row[k + 2]];
    if (!(length > 1e-3) || !Number.isFinite(origin[0] + origin[1] + origin[2])) {
      this.nodes.setScale(shaft, HIDDEN);
      this.nodes.setScale(head, HIDDEN);
      return;
    }
    const wxyz = rotationFromZ(force, norm);
    this.placeNode(shaft, k, wxyz, Math.max(length - head_m, 1e-3));
    this.nodes.setPose(
      head,
      origin.map((x, i) => x + force[i] * arrow_m_per_n),
      wxyz,
    );
    this.nodes.setScale(head, Math.min(1, length / head_m));
  }
}
