// Where the scene is looked at from: its side, its front, from above, and along with what moves.
//
// viser's client keeps its camera controls beside its nodes (nodes.js); they turn and move as a hand would.

const FROM = { side: [0, -1, 0.18], front: [1, -0.12, 0.2], above: [-0.02, 0, 1] }; // ahead is x, left is y
const ROOM_M = 0.6,
  MARGIN = 1.08,
  STILL_M = 0.3,
  BODY_M = 0.25,
  PLACED_FOR = 1.25;

export class Camera {
  constructor(scene) {
    this.scene = scene;
    this.following = false;
    this.last = null;
  }

  get viser() {
    return this.scene.nodes.viser;
  }

  // From one of the sides, with the whole way in sight.
  look(from) {
    const places = this.places(),
      { camera, cameraControl } = this.viser;
    const low = [0, 1, 2].map((i) => Math.min(...places.map((p) => p[i])) - ROOM_M),
      high = [0, 1, 2].map((i) => Math.max(...places.map((p) => p[i])) + ROOM_M);
    const middle = low.map((v, i) => (v + high[i]) / 2),
      radius = Math.hypot(...high.map((v, i) => v - low[i])) / 2;
    const [ahead, left] = this.ahead(places),
      [u, v, w] = FROM[from];
    const towards = [u * ahead[0] + v * left[0], u * ahead[1] + v * left[1], w];
    const half = Math.tan((camera.fov * Math.PI) / 360),
      away = (MARGIN * radius) / (half * Math.min(1, camera.aspect)) / Math.hypot(...towards);
    const to = this.drawn(middle),
      at = this.drawn(middle.map((v, i) => v + away * towards[i]));
    cameraControl.setLookAt(at.x, at.y, at.z, to.x, to.y, to.z, false);
    this.viser.requestRender();
  }

  // On a page that is higher than wide, the way is not in sight or small: comes near to what moves, from where it looks.
  // Tells whether it did.
  near(at) {
    const { camera, cameraControl } = this.viser,
      found = this.all(at);
    if (camera.aspect >= 1 || !found.length) return false;
    const low = [0, 1, 2].map((i) => Math.min(...found.map((p) => p[i]))),
      high = [0, 1, 2].map((i) => Math.max(...found.map((p) => p[i])));
    const radius = Math.hypot(...high.map((v, i) => v - low[i])) / 2 + BODY_M,
      to = this.drawn(low.map((v, i) => (v + high[i]) / 2));
    const towards = cameraControl.getPosition(to.clone()).sub(cameraControl.getTarget(to.clone())).normalize();
    const from = to.clone().addScaledVector(towards, radius / (Math.tan((camera.fov * Math.PI) / 360) * camera.aspect));
    cameraControl.setLookAt(from.x, from.y, from.z, to.x, to.y, to.z, false);
    return true;
  }

  follow(on, at) {
    this.following = on;
    this.last = on ? this.middle(at) : null;
  }

  // Moves along with what has moved since the last frame that was shown.
  shown(at) {
    const now = this.following ? this.middle(at) : null;
    if (!now || !this.last) {
      this.last = now ?? this.last;
      return;
    }
    const by = this.drawn(now).sub(this.drawn(this.last)),
      { cameraControl } = this.viser;
    const target = cameraControl.getTarget(by.clone()).add(by);
    cameraControl.moveTo(target.x, target.y, target.z, false);
    this.last = now;
  }

  // A place of the world as viser draws it, which has y upwards.
  /** @param {number[]} place */
  drawn([x, y, z]) {
    return this.viser.nodeRefFromName[""].localToWorld(this.viser.camera.position.clone().set(x, y, z));
  }

  // Horizontal unit vectors along the way and to its left; along x where nothing gets ahead.
  ahead(places) {
    const d = [0, 1].map((i) => places.at(-1)[i] - places[0][i]),
      length = Math.hypot(...d);
    const [x, y] = length > STILL_M ? d.map((v) => v / length) : [1, 0];
    return [
      [x, y],
      [-y, x],
    ];
  }

  places() {
    const n = this.scene.layout.n_frames,
      every = Math.max(Math.floor(n / 60), 1);
    const found = Array.from({ length: Math.ceil(n / every) }, (_, k) => this.middle(k * every)).filter(Boolean);
    return found.length ? found : [[0, 0, 1]];
  }

  // The centre of mass at a frame, where there is one, else the mean of what is drawn; null where nothing is.
  middle(at) {
    const { layout, values } = this.scene,
      row = Math.round(at) * layout.width,
      all = this.all(at);
    const com = layout.points.find(([name]) => name.startsWith("/com/"));
    const own = com && [0, 1, 2].map((i) => values[row + com[1] + i]);
    if (own?.every(Number.isFinite)) return own;
    return all.length ? [0, 1, 2].map((i) => all.reduce((sum, p) => sum + p[i], 0) / all.length) : null;
  }

  // Where points and bodies are at a frame, of those that are there.
  all(at) {
    const { layout, values } = this.scene,
      row = Math.round(at) * layout.width;
    return [...layout.points, ...layout.bodies]
      .map(([, k]) => [0, 1, 2].map((i) => values[row + k + i]))
      .filter((p) => p.every(Number.isFinite));
  }
}

// Goes back from a scene that was placed for a picture of another shape, until its width is in sight (viewer/scene_parts.py, NARROW).
export function widen({ camera, cameraControl }) {
  if (camera.aspect < PLACED_FOR) cameraControl.dollyTo((cameraControl.distance * PLACED_FOR) / camera.aspect, false);
}
