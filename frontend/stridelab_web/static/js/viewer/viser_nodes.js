// Moves and colours nodes of viser's scene in its frame, without a message from the server.
//
// viser's client keeps node poses in a plain object that its render loop reads (`nodePoseData`) and the three.js
// objects in another (`nodeRefFromName`). The patch with which it is built (frontend/viser_client) makes them available as
// `viserScene` of its window; browser tests compare the nodes with the files that they show.

import { translate } from "../shared/translate.js";
import { hasWebGl2 } from "../shared/web_gl.js";

const POLL_MS = 30,
  PROBE_MS = 3000,
  RECONNECT_MS = 8000;
const NO_WEBGL = translate(
  "This browser cannot draw in 3D: it has no WebGL 2, or it is switched off. Try its setting for hardware acceleration, or another browser.",
);
const NOT_YET = /** @type {any} */ (null);
export const HIDDEN = 1e-6; // a scale of zero would make a matrix that cannot be inverted

// The client in the frame, with its stores and its scene (`mutable`); null before it has started.
/** @param {PageElement} frame @returns {ViserContext | null} */
export function findContext(frame) {
  return frame.contentWindow?.viserScene ?? null;
}

export class ViserNodes {
  /** @param {PageElement} frame @param {string[]} names */
  constructor(frame, names) {
    this.frame = frame;
    this.names = names;
    this.hidden = new Set();
    /** @type {ViserClient} */
    this.viser = NOT_YET;
    this.originalScales = new WeakMap();
    this.originalColors = new WeakMap();
    this.originalTransparency = new WeakMap();
    this.drawnObjects = new Map();
    this.visibility = new WeakMap();
    this.renderOnce = () => this.redraw();
  }

  // Resolves once viser has made every node. A client that lost its first connection, to a viewer that was starting,
  // reconnects only while it has the focus, so it is reloaded. Rejected where the browser cannot draw: the client, which
  // needs that, has not started long after it was asked for.
  ready() {
    /** @type {number | null} */
    let disconnected_ms = null,
      probe_ms = performance.now() + PROBE_MS;
    return new Promise((/** @type {(value?: void) => void} */ done, refuse) => {
      const poll = () => {
        if (performance.now() > probe_ms && !findContext(this.frame)) {
          if (!hasWebGl2()) return refuse(new Error(NO_WEBGL));
          probe_ms = Infinity;
        }
        this.refreshClient();
        if (this.frame.closest("[data-held]")) this.limitRendering();
        const disconnected = findContext(this.frame)?.useGui.get().websocketState === "inactive";
        disconnected_ms = disconnected ? (disconnected_ms ?? performance.now()) : null;
        if (disconnected_ms !== null && performance.now() - disconnected_ms > RECONNECT_MS) {
          disconnected_ms = null;
          this.reload();
        }
        if (this.viser && this.names.every((name) => this.viser.nodeRefFromName[name])) done();
        else setTimeout(poll, POLL_MS);
      };
      poll();
    });
  }

  // Loads viser's client again; `ready` waits for its nodes.
  reload() {
    this.viser = NOT_YET;
    this.frame.contentWindow.location.reload();
  }

  // Resolves once viser has drawn a frame; after it was hidden, it needs several requests to draw again.
  rendered() {
    const { gl } = this.root,
      before = gl.info.render.frame;
    return new Promise((done) => {
      const poll = () => {
        if (gl.info.render.frame > before) return done(this.restoreRendering());
        this.redraw();
        requestAnimationFrame(poll);
      };
      poll();
    });
  }

  // The React context of viser's client; only after `ready`.
  get context() {
    return /** @type {ViserContext} */ (findContext(this.frame));
  }

  // The state of react-three-fiber, which draws the scene.
  get root() {
    return this.viser.root.getState();
  }

  // Requests one frame; viser's own request draws frames for a quarter of a second. A scene that is loading draws itself.
  redraw() {
    if (this.viser.scene) this.root.invalidate();
  }

  // Resolves once the frame that was requested is drawn. That happens in another process, for which the frames of this one
  // do not wait: without a graphics card they follow each other in 30 ms where one takes 700 ms of the processor.
  drawn() {
    const gl = this.root.gl.getContext();
    return new Promise((/** @type {(value?: void) => void} */ done) => {
      const watch = () => {
        const fence = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
        gl.flush();
        const poll = () => {
          if (!fence || gl.isContextLost() || gl.getSyncParameter(fence, gl.SYNC_STATUS) === gl.SIGNALED) {
            gl.deleteSync(fence);
            return done();
          }
          setTimeout(poll, POLL_MS);
        };
        poll();
      };
      requestAnimationFrame(() => requestAnimationFrame(watch)); // the frame is rendered in the first of them
    });
  }

  // Lets viser's own requests draw one frame, too, until its scene is shown: further ones would be equal.
  limitRendering() {
    if (!this.viser?.scene || this.viser.requestRender === this.renderOnce) return;
    this.originalRequestRender = this.viser.requestRender;
    this.viser.requestRender = this.renderOnce;
  }

  restoreRendering() {
    if (this.originalRequestRender && this.viser.requestRender === this.renderOnce)
      this.viser.requestRender = this.originalRequestRender;
  }

  refreshClient() {
    this.viser = findContext(this.frame)?.mutable.current ?? this.viser;
  }

  // Draws the changes, and remembers the objects of the nodes for `isStale`.
  draw() {
    for (const name of this.names) this.drawnObjects.set(name, this.viser.nodeRefFromName[name]);
    this.redraw();
  }

  // Whether viser has made new objects for the nodes since the last `draw`, as after a lost connection.
  isStale() {
    const viser = findContext(this.frame)?.mutable.current;
    return (
      viser !== undefined &&
      this.names.every((name) => viser.nodeRefFromName[name]) &&
      this.names.some((name) => viser.nodeRefFromName[name] !== this.drawnObjects.get(name))
    );
  }

  // Whether viser has placed everything that was moved. A node without an object, as after a lost connection, is not.
  isPlaced() {
    return this.names.every((name) => this.viser.nodePoseData[name]?.poseUpdateState === "updated");
  }

  /** @param {string} name */
  positionOf(name) {
    return this.viser?.nodePoseData[name]?.position ?? null;
  }

  /** @param {string} name @param {number[]} position @param {number[] | null} [wxyz] */
  setPose(name, position, wxyz) {
    const pose = this.viser.nodePoseData[name];
    if (!pose) return;
    pose.position = position;
    if (wxyz) pose.wxyz = wxyz;
    if (pose.poseUpdateState !== "waitForMakeObject") pose.poseUpdateState = "needsUpdate";
  }

  // Draws a node in front of everything and of nodes with a smaller `order`; with 0, at its depth again.
  /** @param {string} name @param {number} order */
  drawInFront(name, order) {
    this.viser.nodeRefFromName[name]?.traverse((part) => {
      if (!part.material) return;
      part.material.depthTest = order === 0;
      if (!this.originalTransparency.has(part.material))
        this.originalTransparency.set(part.material, part.material.transparent);
      part.material.transparent = order > 0 || this.originalTransparency.get(part.material); // drawn after opaque ones
      part.renderOrder = order;
    });
  }

  // Shows or hides a node and its descendants, by layers: viser sets `visible` in each frame. Descendants with a scale of
  // their own are then shown or hidden again by the next `setScale`.
  /** @param {string} name @param {boolean} visible */
  setVisible(name, visible) {
    const node = this.viser.nodeRefFromName[name];
    node?.traverse((part) => {
      part.layers.mask = visible ? 1 : 0;
      if (part !== node) this.visibility.delete(part);
    });
  }

  // Draws a transparent node after those with a smaller `order`, without hiding what is inside or behind it.
  /** @param {string} name @param {number} order */
  drawTransparent(name, order) {
    this.viser.nodeRefFromName[name]?.traverse((part) => {
      if (!part.material) return;
      part.material.depthWrite = false;
      part.renderOrder = order;
    });
  }

  // The meshes of a node, without those of its descendants.
  /** @param {string} name */
  meshes(name) {
    return this.viser.nodeRefFromName[name]?.children.filter((part) => part.isMesh) ?? [];
  }

  // Moves the vertices of a node's mesh; `points` are as many.
  /** @param {string} name @param {number[][]} points */
  setVertices(name, points) {
    for (const { geometry } of this.meshes(name)) {
      const { position } = geometry.attributes;
      for (const [k, point] of points.entries()) position.setXYZ(k, point[0], point[1], point[2]);
      position.needsUpdate = true;
      geometry.computeBoundingSphere(); // otherwise the mesh is culled by its old positions
    }
  }

  // Colours a node's mesh; null restores its own colour.
  /** @param {string} name @param {number[] | null} rgb @param {number} opacity */
  setColor(name, rgb, opacity) {
    for (const { material } of this.meshes(name)) {
      if (!this.originalColors.has(material)) this.originalColors.set(material, material.color.clone());
      if (rgb) material.color.setStyle(`rgb(${rgb})`);
      else material.color.copy(this.originalColors.get(material));
      material.opacity = opacity;
      material.transparent = opacity < 1;
    }
  }

  // Whether a node is in a hidden group.
  /** @param {string} name */
  isHidden(name) {
    return [...this.hidden].some((group) => name.startsWith(group));
  }

  /** @param {string} name @param {number} x */
  setScale(name, x, y = x, z = y) {
    const object = this.viser.nodeRefFromName[name];
    if (!object) return;
    // viser stores the size of some shapes as their scale, which is multiplied here.
    if (!this.originalScales.has(object)) this.originalScales.set(object, object.scale.clone());
    const original = this.originalScales.get(object);
    const hidden = this.isHidden(name),
      visible = !hidden && Math.max(x, y, z) > HIDDEN;
    object.scale.set(
      original.x * (hidden ? HIDDEN : x),
      original.y * (hidden ? HIDDEN : y),
      original.z * (hidden ? HIDDEN : z),
    );
    if (this.visibility.get(object) === visible) return;
    this.visibility.set(object, visible);
    this.setVisible(name, visible); // a tiny object would still be drawn
  }
}
