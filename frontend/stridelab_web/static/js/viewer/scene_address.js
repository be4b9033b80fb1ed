// The part of the address that restores what was seen: layers that differ from the default, the camera, and following.

const CAMERA = "camera",
  FOLLOW = "follow",
  SHOW = "show",
  HIDE = "hide",
  SAME_M = 2e-3;

/** @typedef {{ prefix: string, checked: boolean, byDefault: boolean }} LayerState */

// The name of a layer in the address.
/** @param {string} prefix */
const layerName = (prefix) => prefix.replace(/^\/|\/$/g, "");

// Writes the layers that differ from their default into a query.
/** @param {URLSearchParams} query @param {LayerState[]} layers */
export function writeLayers(query, layers) {
  for (const [key, shown] of /** @type {[string, boolean][]} */ ([
    [SHOW, true],
    [HIDE, false],
  ])) {
    const names = layers.filter(({ checked, byDefault }) => checked !== byDefault && checked === shown);
    if (names.length) query.set(key, names.map(({ prefix }) => layerName(prefix)).join(","));
    else query.delete(key);
  }
}

// Whether a layer is shown by a query; `byDefault` where it says nothing.
/** @param {URLSearchParams} query @param {string} prefix @param {boolean} byDefault */
export function isLayerShown(query, prefix, byDefault) {
  const has = (/** @type {string} */ key) => (query.get(key) ?? "").split(",").includes(layerName(prefix));
  return has(SHOW) || (byDefault && !has(HIDE));
}

// Position and target of the camera as six numbers in a query; null without them.
/** @param {URLSearchParams} query @returns {number[] | null} */
export function readCamera(query) {
  const numbers = (query.get(CAMERA) ?? "").split(",").map(Number);
  return query.get(CAMERA) && numbers.length === 6 && numbers.every(Number.isFinite) ? numbers : null;
}

/** @param {URLSearchParams} query @param {number[]} camera */
export function writeCamera(query, camera) {
  query.set(CAMERA, camera.map((v) => String(Math.round(v * 1000) / 1000)).join(","));
}

/** @param {number[] | null} a @param {number[] | null} b */
export const sameCamera = (a, b) =>
  a === b || (a !== null && b !== null && a.every((v, i) => Math.abs(v - b[i]) < SAME_M));

// Restores the layers and the camera of the address, and writes them while they change.
export class SceneAddress {
  // `player` contains the check boxes of the layers and `[data-follow]`.
  /** @param {PageElement} player */
  constructor(player) {
    this.boxes = [...player.querySelectorAll("[data-show]")];
    this.followBox = player.querySelector("[data-follow]");
    this.camera = null;
    const query = new URLSearchParams(location.search);
    for (const box of this.boxes) box.checked = isLayerShown(query, box.dataset.show, box.defaultChecked);
    for (const box of this.boxes) box.addEventListener("change", () => this.writeLayers());
  }

  // Moves the camera to the place of the address; false without one. Later changes of the camera are written.
  /** @param {import("./camera.js").Camera} camera */
  restoreCamera(camera) {
    this.camera = camera;
    const query = new URLSearchParams(location.search),
      place = readCamera(query);
    if (place) camera.moveTo(place);
    this.written = camera.place();
    return place !== null;
  }

  get isFollowing() {
    return new URLSearchParams(location.search).has(FOLLOW);
  }

  // Called from time to time.
  update() {
    const place = this.camera?.place();
    if (!place || sameCamera(place, this.written ?? null)) return;
    this.written = place;
    this.edit((query) => writeCamera(query, place));
  }

  writeLayers() {
    const layers = this.boxes.map((box) => ({
      prefix: box.dataset.show,
      checked: box.checked,
      byDefault: box.defaultChecked,
    }));
    this.edit((query) => writeLayers(query, layers));
  }

  writeFollow() {
    this.edit((query) => (this.followBox.checked ? query.set(FOLLOW, "1") : query.delete(FOLLOW)));
  }

  /** @param {(query: URLSearchParams) => void} change */
  edit(change) {
    const url = new URL(location.href);
    change(url.searchParams);
    url.search = url.search.replaceAll("%2C", ",").replaceAll("%2F", "/");
    history.replaceState(null, "", url);
  }
}
