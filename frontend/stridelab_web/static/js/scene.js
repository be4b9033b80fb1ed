// Moves the nodes of viser's scene from our frames, without a message per frame from the server.
//
// viser has no trajectory of its own in a live scene. Its client keeps node poses in a plain object that its render
// loop reads (`nodePoseData`) and the three.js objects in another (`nodeRefFromName`); both are private, so viser is
// pinned exactly and a browser test compares a node with tracks.parquet after a seek.

const FIND_EVERY_MS = 100;
const HIDDEN = 1e-6; // a scale of zero would make a matrix that cannot be inverted

export function findViser(frame) {
  const inside = frame.contentWindow;
  if (!inside) return null;
  if (inside.__viserMutable?.nodePoseData) return inside.__viserMutable;
  for (let node = frame.contentDocument?.querySelector("canvas"); node; node = node.parentElement) {
    const key = Object.keys(node).find((name) => name.startsWith("__reactFiber$"));
    for (let fiber = key && node[key]; fiber; fiber = fiber.return) {
      const found = fiber.memoizedProps?.value?.mutable?.current;
      if (found?.nodePoseData) return found;
    }
  }
  return null;
}

export class Scene {
  constructor(frame, layout, values) {
    this.frame = frame;
    this.layout = layout;
    this.values = values;
    this.hidden = new Set();
    this.viser = null;
    this.own = new WeakMap();
    this.seen = new Map();
    this.row = new Float64Array(layout.width);
    this.names = [
      ...layout.points.map(([name]) => name),
      ...layout.sticks.map(([name]) => name),
      ...layout.arrows.flatMap(([shaft, head]) => [shaft, head]),
    ];
  }

  // Resolves once viser has made every node.
  ready() {
    return new Promise((done) => {
      const look = () => {
        this.viser = findViser(this.frame);
        const there = this.viser && this.names.every((name) => this.viser.nodeRefFromName[name]);
        if (there) done();
        else setTimeout(look, FIND_EVERY_MS);
      };
      look();
    });
  }

  // Shows the frame `at` (a real number: between two frames, positions are interpolated).
  show(at) {
    this.viser = findViser(this.frame) ?? this.viser;
    this.fill(at);
    for (const [name, k] of this.layout.points) this.place(name, k, null, 1);
    for (const [name, a, b] of this.layout.sticks) this.stick(name, a, b);
    for (const [shaft, head, k] of this.layout.arrows) this.arrow(shaft, head, k);
    for (const group of ["/paths/fused", "/paths/markers_only", "/paths/band"]) this.scale(group, 1, 1);
    for (const name of this.names) this.seen.set(name, this.viser.nodeRefFromName[name]);
    this.viser.requestRender();
  }

  // Whether viser has made nodes anew since the last `show` (after a lost connection): they stand where it put them.
  isStale() {
    const viser = findViser(this.frame);
    return viser !== null && this.names.every((name) => viser.nodeRefFromName[name]) && this.names.some((name) => viser.nodeRefFromName[name] !== this.seen.get(name));
  }

  fill(at) {
    const { width, n_frames } = this.layout;
    const low = Math.min(Math.max(Math.floor(at), 0), n_frames - 1);
    const high = Math.min(low + 1, n_frames - 1);
    const part = at - low;
    const a = low * width, b = high * width;
    for (let k = 0; k < width; k += 1) {
      this.row[k] = part === 0 ? this.values[a + k] : (1 - part) * this.values[a + k] + part * this.values[b + k];
    }
  }

  place(name, k, wxyz, length) {
    const [x, y, z] = [this.row[k], this.row[k + 1], this.row[k + 2]];
    const there = Number.isFinite(x + y + z);
    if (there) this.pose(name, [x, y, z], wxyz);
    this.scale(name, there ? 1 : HIDDEN, there ? length : HIDDEN);
  }

  stick(name, a, b) {
    const d = [0, 1, 2].map((i) => this.row[b + i] - this.row[a + i]);
    const length = Math.hypot(...d);
    if (!(length > 1e-6)) this.scale(name, HIDDEN, HIDDEN);
    else this.place(name, a, towards(d, length), length);
  }

  arrow(shaft, head, k) {
    const force = [this.row[k + 3], this.row[k + 4], this.row[k + 5]];
    const norm = Math.hypot(...force);
    const length = norm * this.layout.arrow_m_per_n;
    const origin = [this.row[k], this.row[k + 1], this.row[k + 2]];
    if (!(length > 1e-3) || !Number.isFinite(origin[0] + origin[1] + origin[2])) {
      this.scale(shaft, HIDDEN, HIDDEN);
      this.scale(head, HIDDEN, HIDDEN);
      return;
    }
    const wxyz = towards(force, norm);
    this.place(shaft, k, wxyz, Math.max(length - this.layout.head_m, 1e-3));
    this.pose(head, origin.map((x, i) => x + force[i] * this.layout.arrow_m_per_n), wxyz);
    this.scale(head, 1, 1);
  }

  pose(name, position, wxyz) {
    const pose = this.viser.nodePoseData[name];
    if (!pose) return;
    pose.position = position;
    if (wxyz) pose.wxyz = wxyz;
    if (pose.poseUpdateState !== "waitForMakeObject") pose.poseUpdateState = "needsUpdate";
  }

  scale(name, across, along) {
    const object = this.viser.nodeRefFromName[name];
    if (!object) return;
    // Some shapes carry their size as scale, so ours multiplies the one that viser gave.
    if (!this.own.has(object)) this.own.set(object, object.scale.clone());
    const own = this.own.get(object);
    const off = [...this.hidden].some((group) => name.startsWith(group));
    object.scale.set(own.x * (off ? HIDDEN : across), own.y * (off ? HIDDEN : across), own.z * (off ? HIDDEN : along));
  }
}

// The shortest turn from the z axis to the direction d / norm.
function towards(d, norm) {
  const [x, y, z] = d.map((v) => v / norm);
  if (z < -0.999999) return [0, 1, 0, 0];
  const half = Math.sqrt(2 * (1 + z));
  return [half / 2, -y / half, x / half, 0];
}
