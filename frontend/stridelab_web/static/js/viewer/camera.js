// Moves the camera of the scene: views from the side, the front and above, and following the motion, by the camera
// controls of viser's client.

/** @type {Record<string, number[]>} */
const VIEW_DIRECTIONS = { side: [0, -1, 0.18], front: [1, -0.12, 0.2], above: [-0.02, 0, 1] }; // x is ahead, y is left
const PADDING_M = 0.6,
  MARGIN = 1.08,
  MIN_TRAVEL_M = 0.3,
  BODY_M = 0.25,
  FAR = 1.3,
  DESIGN_ASPECT = 1.25;

export class Camera {
  /** @param {MovingScene} scene */
  constructor(scene) {
    this.scene = scene;
    this.isFollowing = false;
    this.lastCentre = null;
  }

  get viser() {
    return this.scene.nodes.viser;
  }

  // Looks from one of VIEW_DIRECTIONS at the whole path.
  /** @param {string} from */
  lookFrom(from) {
    const points = this.path(),
      { camera, cameraControl } = this.viser;
    const low = [0, 1, 2].map((i) => Math.min(...points.map((p) => p[i])) - PADDING_M),
      high = [0, 1, 2].map((i) => Math.max(...points.map((p) => p[i])) + PADDING_M);
    const middle = low.map((v, i) => (v + high[i]) / 2),
      radius = Math.hypot(...high.map((v, i) => v - low[i])) / 2;
    const [ahead, left] = this.headingAxes(points),
      [u, v, w] = VIEW_DIRECTIONS[from];
    const direction = [u * ahead[0] + v * left[0], u * ahead[1] + v * left[1], w];
    const tangent = Math.tan((camera.fov * Math.PI) / 360),
      distance = (MARGIN * radius) / (tangent * Math.min(1, camera.aspect)) / Math.hypot(...direction);
    const to = this.toViserFrame(middle),
      eye = this.toViserFrame(middle.map((v, i) => v + distance * direction[i]));
    cameraControl.setLookAt(eye.x, eye.y, eye.z, to.x, to.y, to.z, false);
    this.viser.requestRender();
  }

  // Position and target of the camera in viser's frame, six numbers.
  place() {
    const { camera, cameraControl } = this.viser;
    const [from, to] = [
      cameraControl.getPosition(camera.position.clone()),
      cameraControl.getTarget(camera.position.clone()),
    ];
    return [from.x, from.y, from.z, to.x, to.y, to.z];
  }

  /** @param {number[]} values */
  moveTo([x, y, z, u, v, w]) {
    this.viser.cameraControl.setLookAt(x, y, z, u, v, w, false);
    this.viser.requestRender();
  }

  // Where the view of the whole path would show a small body, moves near to it at a frame, in the direction of view: a
  // robot in a scene that is higher than wide, a person wherever the path is long. Returns whether it moved.
  /** @param {number} frame */
  moveNear(frame) {
    const { camera, cameraControl } = this.viser,
      positions = this.positionsAt(frame);
    const isRobot = this.scene.layout.bodies.length > 0;
    if (!positions.length || (isRobot && camera.aspect >= 1)) return false;
    const low = [0, 1, 2].map((i) => Math.min(...positions.map((p) => p[i]))),
      high = [0, 1, 2].map((i) => Math.max(...positions.map((p) => p[i])));
    const radius = Math.hypot(...high.map((v, i) => v - low[i])) / 2 + BODY_M,
      to = this.toViserFrame(low.map((v, i) => (v + high[i]) / 2));
    const offset = cameraControl.getPosition(to.clone()).sub(cameraControl.getTarget(to.clone()));
    const near = radius / (Math.tan((camera.fov * Math.PI) / 360) * Math.min(1, camera.aspect));
    if (camera.aspect >= 1 && offset.length() < FAR * near) return false;
    const from = to.clone().addScaledVector(offset.normalize(), near);
    cameraControl.setLookAt(from.x, from.y, from.z, to.x, to.y, to.z, false);
    return true;
  }

  /** @param {boolean} on @param {number} frame */
  follow(on, frame) {
    this.isFollowing = on;
    this.lastCentre = on ? this.centreAt(frame) : null;
  }

  // While following, shifts the camera by the motion since the last frame.
  /** @param {number} frame */
  onFrame(frame) {
    const now = this.isFollowing ? this.centreAt(frame) : null;
    if (!now || !this.lastCentre) {
      this.lastCentre = now ?? this.lastCentre;
      return;
    }
    const shift = this.toViserFrame(now).sub(this.toViserFrame(this.lastCentre)),
      { cameraControl } = this.viser;
    const target = cameraControl.getTarget(shift.clone()).add(shift);
    cameraControl.moveTo(target.x, target.y, target.z, false);
    this.lastCentre = now;
  }

  // A point of the world frame in three.js' frame, whose y axis points up.
  /** @param {number[]} place */
  toViserFrame([x, y, z]) {
    return this.viser.nodeRefFromName[""].localToWorld(this.viser.camera.position.clone().set(x, y, z));
  }

  // Horizontal unit vectors along the path and to its left; the x axis for a path without travel.
  /** @param {number[][]} points */
  headingAxes(points) {
    const d = [0, 1].map((i) => points[points.length - 1][i] - points[0][i]),
      length = Math.hypot(...d);
    const [x, y] = length > MIN_TRAVEL_M ? d.map((v) => v / length) : [1, 0];
    return [
      [x, y],
      [-y, x],
    ];
  }

  // Centres at up to about 60 frames.
  path() {
    const n = this.scene.layout.n_frames,
      stride = Math.max(Math.floor(n / 60), 1);
    const positions = Array.from({ length: Math.ceil(n / stride) }, (_, k) => this.centreAt(k * stride)).filter(
      (centre) => centre !== null,
    );
    return positions.length ? positions : [[0, 0, 1]];
  }

  // The centre of mass at a frame, else the mean of the positions; null without any.
  /** @param {number} frame */
  centreAt(frame) {
    const { layout, values } = this.scene,
      row = Math.round(frame) * layout.width,
      positions = this.positionsAt(frame);
    const point = layout.points.find(([name]) => name.startsWith("/com/"));
    const com = point && [0, 1, 2].map((i) => values[row + point[1] + i]);
    if (com?.every(Number.isFinite)) return com;
    return positions.length
      ? [0, 1, 2].map((i) => positions.reduce((sum, p) => sum + p[i], 0) / positions.length)
      : null;
  }

  // Positions of the points, bodies and limbs that exist at a frame.
  /** @param {number} frame */
  positionsAt(frame) {
    const { layout, values } = this.scene,
      row = Math.round(frame) * layout.width;
    const limbs = layout.sticks.filter(([name]) => name.startsWith("/body/"));
    return [...[...layout.points, ...layout.bodies].map(([, k]) => k), ...limbs.map(([, , end]) => end)]
      .map((k) => [0, 1, 2].map((i) => values[row + k + i]))
      .filter((p) => p.every(Number.isFinite));
  }
}

// Moves the camera back until the width of the scene is visible: its initial view is made for DESIGN_ASPECT
// (viewer/scene_parts.py, NARROW).
/** @param {{ camera: SceneCamera, cameraControl: CameraControls }} options */
export function fitWidth({ camera, cameraControl }) {
  if (camera.aspect < DESIGN_ASPECT)
    cameraControl.dollyTo((cameraControl.distance * DESIGN_ASPECT) / camera.aspect, false);
}
