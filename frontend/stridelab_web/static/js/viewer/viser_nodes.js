// Moves nodes of viser's scene in the frame, without a message from the server.
//
// viser's client keeps node poses in a plain object that its render loop reads (`nodePoseData`) and the three.js
// objects in another (`nodeRefFromName`); both are private, so viser is pinned exactly and browser tests compare nodes
// with the files that they show.

const FIND_EVERY_MS = 30,
  LOST_MS = 8000;
const NOT_YET = /** @type {any} */ (null);
export const HIDDEN = 1e-6; // a scale of zero would make a matrix that cannot be inverted

// What viser's client hands down to its own parts: stores, and `mutable` with its scene; null before it is there.
/** @param {PageElement} frame @returns {ViserContext | null} */
export function findContext(frame) {
  for (let node = frame.contentDocument?.querySelector("canvas"); node; node = node.parentElement) {
    const key = Object.keys(node).find((name) => name.startsWith("__reactFiber$"));
    for (let fiber = key && node[key]; fiber; fiber = fiber.return) {
      const found = fiber.memoizedProps?.value;
      if (found?.mutable?.current?.nodePoseData) return found;
    }
  }
  return null;
}

/** @param {PageElement} frame @returns {ViserClient | null} */
function findViser(frame) {
  const known = frame.contentWindow?.__viserMutable;
  return known?.nodePoseData ? known : (findContext(frame)?.mutable.current ?? null);
}

export class Nodes {
  constructor(frame, names) {
    this.frame = frame;
    this.names = names;
    this.hidden = new Set();
    /** @type {ViserClient} */
    this.viser = NOT_YET;
    this.own = new WeakMap();
    this.colours = new WeakMap();
    this.clear = new WeakMap();
    this.seen = new Map();
    this.there = new WeakMap();
    this.once = () => this.redraw();
  }

  // Resolves once viser has made every node. A client that lost its first connection, to a viewer that was starting,
  // tries again only where it has the focus: it is loaded anew.
  ready() {
    /** @type {number | null} */
    let lost_ms = null;
    return new Promise((/** @type {(value?: void) => void} */ done) => {
      const look = () => {
        this.find();
        if (this.frame.closest("[data-held]")) this.calm();
        const alone = findContext(this.frame)?.useGui.get().websocketState === "inactive";
        lost_ms = alone ? (lost_ms ?? performance.now()) : null;
        if (lost_ms !== null && performance.now() - lost_ms > LOST_MS) {
          lost_ms = null;
          this.reload();
        }
        if (this.viser && this.names.every((name) => this.viser.nodeRefFromName[name])) done();
        else setTimeout(look, FIND_EVERY_MS);
      };
      look();
    });
  }

  // Loads viser's client again; `ready` waits for its nodes.
  reload() {
    this.viser = NOT_YET;
    this.frame.contentWindow.location.reload();
  }

  // Resolves once viser has drawn a picture. It notices only with the next ones that it is in sight again.
  drawn() {
    const { gl } = this.root,
      before = gl.info.render.frame;
    return new Promise((done) => {
      const look = () => {
        if (gl.info.render.frame > before) return done(this.uncalm());
        this.redraw();
        requestAnimationFrame(look);
      };
      look();
    });
  }

  // The context of viser's client, which is there once the nodes are ready.
  get context() {
    return /** @type {ViserContext} */ (findContext(this.frame));
  }

  // What draws the scene.
  get root() {
    return this.viser.scene.__r3f.root.getState();
  }

  // Asks for one picture; viser's own request is for all that a quarter of a second has room for.
  redraw() {
    this.root.invalidate();
  }

  // Until its scene is drawn, viser's requests are for one picture too: what comes after the first would be the same.
  calm() {
    if (!this.viser?.scene || this.viser.requestRender === this.once) return;
    this.request = this.viser.requestRender;
    this.viser.requestRender = this.once;
  }

  uncalm() {
    if (this.request && this.viser.requestRender === this.once) this.viser.requestRender = this.request;
  }

  find() {
    this.viser = findViser(this.frame) ?? this.viser;
  }

  // Draws what was changed, and remembers which nodes it was drawn with.
  draw() {
    for (const name of this.names) this.seen.set(name, this.viser.nodeRefFromName[name]);
    this.redraw();
  }

  // Whether viser has made nodes anew since the last `draw` (after a lost connection): they stand where it put them.
  isStale() {
    const viser = findViser(this.frame);
    return (
      viser !== null &&
      this.names.every((name) => viser.nodeRefFromName[name]) &&
      this.names.some((name) => viser.nodeRefFromName[name] !== this.seen.get(name))
    );
  }

  position(name) {
    return this.viser?.nodePoseData[name]?.position ?? null;
  }

  pose(name, position, wxyz) {
    const pose = this.viser.nodePoseData[name];
    if (!pose) return;
    pose.position = position;
    if (wxyz) pose.wxyz = wxyz;
    if (pose.poseUpdateState !== "waitForMakeObject") pose.poseUpdateState = "needsUpdate";
  }

  // Draws a node over whatever is in front of it and over nodes with a smaller `turn`; as any other with none.
  over(name, turn) {
    this.viser.nodeRefFromName[name]?.traverse((part) => {
      if (!part.material) return;
      part.material.depthTest = turn === 0;
      if (!this.clear.has(part.material)) this.clear.set(part.material, part.material.transparent);
      part.material.transparent = turn > 0 || this.clear.get(part.material); // drawn after the opaque ones, by their turn
      part.renderOrder = turn;
    });
  }

  // Whether a node and all below it are drawn: viser decides anew about `visible` with each picture, but not of layers.
  see(name, on) {
    this.viser.nodeRefFromName[name]?.traverse((part) => {
      part.layers.mask = on ? 1 : 0;
    });
  }

  // Draws a see-through node after those with a smaller `turn`, without hiding what is within or behind it.
  veil(name, turn) {
    this.viser.nodeRefFromName[name]?.traverse((part) => {
      if (!part.material) return;
      part.material.depthWrite = false;
      part.renderOrder = turn;
    });
  }

  // The meshes of a node itself, without those of the nodes below it.
  meshes(name) {
    return this.viser.nodeRefFromName[name]?.children.filter((part) => part.isMesh) ?? [];
  }

  // Gives the vertices of a node's mesh other places, as many as it has.
  reshape(name, points) {
    for (const { geometry } of this.meshes(name)) {
      const { position } = geometry.attributes;
      for (const [k, point] of points.entries()) position.setXYZ(k, point[0], point[1], point[2]);
      position.needsUpdate = true;
      geometry.computeBoundingSphere(); // what is out of sight by its old places would not be drawn
    }
  }

  // Colours a node's mesh, or gives it back its own colour with null.
  paint(name, rgb, opacity) {
    for (const { material } of this.meshes(name)) {
      if (!this.colours.has(material)) this.colours.set(material, material.color.clone());
      if (rgb) material.color.setStyle(`rgb(${rgb})`);
      else material.color.copy(this.colours.get(material));
      material.opacity = opacity;
      material.transparent = opacity < 1;
    }
  }

  // Whether the layer of a node is switched off.
  isHidden(name) {
    return [...this.hidden].some((group) => name.startsWith(group));
  }

  scale(name, x, y = x, z = y) {
    const object = this.viser.nodeRefFromName[name];
    if (!object) return;
    // Some shapes carry their size as scale, so ours multiplies the one that viser gave.
    if (!this.own.has(object)) this.own.set(object, object.scale.clone());
    const own = this.own.get(object);
    const off = this.isHidden(name),
      there = !off && Math.max(x, y, z) > HIDDEN;
    object.scale.set(own.x * (off ? HIDDEN : x), own.y * (off ? HIDDEN : y), own.z * (off ? HIDDEN : z));
    if (this.there.get(object) === there) return;
    this.there.set(object, there);
    this.see(name, there); // so small it cannot be seen, but it would be drawn
  }
}
