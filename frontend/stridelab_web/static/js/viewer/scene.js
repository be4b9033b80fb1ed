// Shows one instant of our frames: points, bodies, sticks, arrows, ellipsoids, hoops, and what is there for a while only.
import { cubic } from "./interpolation.js";
import { Copies } from "./mesh_copies.js";
import { HIDDEN, Nodes } from "./viser_nodes.js";
import { towards } from "./quaternions.js";

const arrowNodes = (layout) => layout.arrows.flatMap((arrow) => arrow.slice(0, 2));
const COM = ["/com/plan", "/com/plan/light"]; // the two halves of its ball (viewer/plan_scene.py)

export class Scene {
  constructor(frame, layout, values) {
    this.layout = layout;
    this.values = values;
    // What a robot's body would hide, and whether it is drawn over the body.
    const cones = layout.points.map(([name]) => name).filter((name) => name.startsWith("/cones/"));
    const within = [
      ...cones,
      ...arrowNodes(layout),
      ...layout.still.filter((name) => name.startsWith("/paths/")),
      ...COM,
    ];
    this.inside = layout.bodies.length ? within : [];
    this.through = true;
    this.magnified = 1;
    this.row = new Float64Array(layout.width);
    this.copies = new Copies(layout.copies);
    this.nodes = new Nodes(frame, [
      ...layout.points.map(([name]) => name),
      ...layout.bodies.map(([name]) => name),
      ...layout.sticks.map(([name]) => name),
      ...arrowNodes(layout),
      ...layout.ellipsoids.map(([name]) => name),
      ...layout.hoops.map(([name]) => name),
      ...layout.spans.map(([name]) => name),
      ...this.inside,
    ]);
  }

  // What is drawn as points, lines and arrows; the ball of the centre of mass has its light half with it.
  get tinted() {
    const { points, sticks, still } = this.layout;
    const names = [
      ...points.map(([name]) => name),
      ...sticks.map(([name]) => name),
      ...arrowNodes(this.layout),
      ...still,
    ];
    return names.filter((name) => !COM.includes(name) && !name.startsWith("/cones/"));
  }

  hide(prefixes) {
    this.nodes.hidden = new Set(prefixes);
  }

  // Shows the frame `at` (a real number: between two frames, positions and turns are interpolated).
  show(at) {
    this.nodes.find();
    this.copies.make(this.nodes.viser.nodeRefFromName);
    this.fill(at);
    for (const [name, k] of this.layout.points) this.place(name, k, null, 1);
    for (const [name, k] of this.layout.bodies) this.place(name, k, this.turn(k), 1);
    for (const [name, a, b] of this.layout.sticks) this.stick(name, a, b);
    for (const [shaft, head, k] of this.layout.arrows) this.arrow(shaft, head, k);
    for (const [name, k, axes] of this.layout.ellipsoids) this.ellipsoid(name, k, axes);
    for (const [name, k, size] of this.layout.hoops) this.hoop(name, k, size);
    const t_s = this.timeAt(at);
    for (const [name, start_s, end_s] of this.layout.spans) {
      this.nodes.scale(name, start_s <= t_s && t_s <= end_s ? 1 : HIDDEN);
    }
    for (const name of this.layout.still) this.nodes.scale(name, 1);
    for (const [k, name] of this.inside.entries()) this.nodes.over(name, this.through ? k + 1 : 0);
    this.nodes.draw();
  }

  around(at) {
    const last = this.layout.n_frames - 1;
    const low = Math.min(Math.max(Math.floor(at), 0), last);
    return [low, Math.min(low + 1, last), at - low];
  }

  timeAt(at) {
    const [low, high, part] = this.around(at);
    return (1 - part) * this.layout.time_s[low] + part * this.layout.time_s[high];
  }

  fill(at) {
    const { width, bodies, time_s } = this.layout;
    const [low, high, part] = this.around(at);
    for (let k = 0; k < width; k += 1) {
      const a = this.values[low * width + k],
        b = this.values[high * width + k];
      this.row[k] = part === 0 ? a : (1 - part) * a + part * b;
    }
    const weights = part > 0 && bodies.length ? cubic(time_s, low, part) : null;
    for (const [, k] of bodies) if (weights) this.bend(k, low, weights);
  }

  // Beside a frame in which a body is not there, the straight line stays.
  bend(from, low, weights) {
    const { width } = this.layout;
    for (let k = from; k < from + 7; k += 1) {
      let sum = 0;
      for (const [i, weight] of weights.entries())
        if (weight !== 0) sum += weight * this.values[(low - 1 + i) * width + k];
      if (Number.isFinite(sum)) this.row[k] = sum;
    }
  }

  // The quaternion of the body at k, brought to length one; frames come without jumps of its sign.
  turn(k) {
    const wxyz = [0, 1, 2, 3].map((i) => this.row[k + 3 + i]),
      norm = Math.hypot(...wxyz);
    return wxyz.map((v) => v / norm);
  }

  place(name, k, wxyz, length) {
    const [x, y, z] = [this.row[k], this.row[k + 1], this.row[k + 2]];
    const there = Number.isFinite(x + y + z);
    if (there) this.nodes.pose(name, [x, y, z], wxyz);
    const across = there ? 1 : HIDDEN;
    this.nodes.scale(name, across, across, there ? length : HIDDEN);
  }

  // A unit ball with three semi-axes along x, y and z; what is small may be shown magnified.
  ellipsoid(name, k, axes) {
    this.place(name, k, null, 1);
    const semi = [this.row[axes], this.row[axes + 1], this.row[axes + 2]];
    const there = Number.isFinite(this.row[k] + this.row[k + 1] + this.row[k + 2] + semi[0] + semi[1] + semi[2]);
    this.nodes.scale(name, ...semi.map((length) => (there ? Math.max(this.magnified * length, HIDDEN) : HIDDEN)));
  }

  // A node of unit size, turned and as large as its number says.
  hoop(name, k, size) {
    this.place(name, k, this.turn(k), 1);
    if (Number.isFinite(this.row[k] + this.row[size])) this.nodes.scale(name, this.row[size]);
  }

  stick(name, a, b) {
    const d = [0, 1, 2].map((i) => this.row[b + i] - this.row[a + i]);
    const length = Math.hypot(...d);
    if (!(length > 1e-6)) this.nodes.scale(name, HIDDEN);
    else this.place(name, a, towards(d, length), length);
  }

  // A force shorter than its head is drawn as a smaller head alone.
  arrow(shaft, head, k) {
    const { arrow_m_per_n, head_m } = this.layout;
    const force = [this.row[k + 3], this.row[k + 4], this.row[k + 5]];
    const norm = Math.hypot(...force);
    const length = norm * arrow_m_per_n;
    const origin = [this.row[k], this.row[k + 1], this.row[k + 2]];
    if (!(length > 1e-3) || !Number.isFinite(origin[0] + origin[1] + origin[2])) {
      this.nodes.scale(shaft, HIDDEN);
      this.nodes.scale(head, HIDDEN);
      return;
    }
    const wxyz = towards(force, norm);
    this.place(shaft, k, wxyz, Math.max(length - head_m, 1e-3));
    this.nodes.pose(
      head,
      origin.map((x, i) => x + force[i] * arrow_m_per_n),
      wxyz,
    );
    this.nodes.scale(head, Math.min(1, length / head_m));
  }
}
