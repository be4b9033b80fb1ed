// The parts of viser's client, three.js and react-three-fiber that the viewer takes hold of. The client is built with a
// patch that makes them available (frontend/viser_client), from one version of viser.

interface ViserWindow extends Window {
  viserScene?: ViserContext;
}

interface ViserClient {
  nodePoseData: Record<string, { position: number[]; wxyz: number[]; poseUpdateState: string } | undefined>;
  nodeRefFromName: Record<string, SceneObject>;
  root: { getState(): RenderState };
  scene: SceneObject;
  camera: SceneCamera;
  cameraControl: CameraControls;
  canvas: HTMLCanvasElement;
  requestRender(): void;
}

interface ViserContext {
  mutable: { current: ViserClient };
  useDevSettings: { set(settings: { fixedDpr: number }): void };
  useGui: {
    get(): { websocketState: string; theme: { dark_mode: boolean } };
    set(state: object): void;
    subscribe(listener: () => void): void;
  };
}

interface RenderState {
  gl: {
    info: { render: { frame: number } };
    render(scene: SceneObject, camera: SceneCamera): void;
    getContext(): WebGL2RenderingContext;
  };
  internal: { subscribe(callback: { current: () => void }, priority: number, root: object): void };
  invalidate(): void;
}

interface Vector3 {
  x: number;
  y: number;
  z: number;
  set(x: number, y: number, z: number): Vector3;
  clone(): Vector3;
  add(other: Vector3): Vector3;
  sub(other: Vector3): Vector3;
  normalize(): Vector3;
  length(): number;
  addScaledVector(other: Vector3, scale: number): Vector3;
  project(camera: SceneCamera): Vector3;
  unproject(camera: SceneCamera): Vector3;
}

interface Color {
  getHexString(): string;
  r: number;
  g: number;
  b: number;
  clone(): Color;
  copy(other: Color): Color;
  getHSL(target: object): { h: number; s: number; l: number };
  setHSL(h: number, s: number, l: number): Color;
  setStyle(style: string): Color;
}

interface Material {
  clone(): Material;
  color: Color;
  depthTest: boolean;
  depthWrite: boolean;
  opacity: number;
  transparent: boolean;
  vertexColors: boolean;
  uniforms?: Record<string, { value: Color }>;
}

interface Attribute {
  array: ArrayLike<number> & Iterable<number>;
  needsUpdate: boolean;
  setXYZ(index: number, x: number, y: number, z: number): void;
}

interface Geometry {
  attributes: { position: Attribute };
  index: Attribute;
  computeBoundingSphere(): void;
  computeVertexNormals(): void;
  setAttribute(name: string, attribute: Attribute): void;
  setIndex(attribute: Attribute): void;
}

interface SceneObject {
  add(child: SceneObject): void;
  remove(...children: SceneObject[]): void;
  clone(recursive: boolean): SceneObject;
  traverse(visit: (object: SceneObject) => void): void;
  localToWorld(point: Vector3): Vector3;
  worldToLocal(point: Vector3): Vector3;
  children: SceneObject[];
  geometry: Geometry;
  isMesh?: boolean;
  layers: { mask: number };
  material: Material;
  position: Vector3;
  renderOrder: number;
  scale: Vector3;
  userData: { copied?: boolean };
  visible: boolean;
}

interface SceneCamera {
  aspect: number;
  fov: number;
  position: Vector3;
  clone(): SceneCamera;
  setViewOffset(fullWidth: number, fullHeight: number, x: number, y: number, width: number, height: number): void;
}

interface CameraControls {
  distance: number;
  dollyTo(distance: number, animated: boolean): void;
  getPosition(target: Vector3): Vector3;
  getTarget(target: Vector3): Vector3;
  moveTo(x: number, y: number, z: number, animated: boolean): void;
  setLookAt(x: number, y: number, z: number, toX: number, toY: number, toZ: number, animated: boolean): void;
}
