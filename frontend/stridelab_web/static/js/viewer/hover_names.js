// Names what the mouse points at in the scene: markers, centres of mass and other points, and forces with their newtons.
import { translate } from "../shared/translate.js";

const REACH_PX = 14;

/** @typedef {{ text: string, at: number[] }} Named a name with its place in the scene, in metres */
/** @typedef {{ values: ArrayLike<number>, points: [string, number, string][], arrows: [string, string, number, string][],
 *   arrowMPerN: number, isHidden: (name: string) => boolean }} Instant what is drawn at one instant */

/** @param {string} label @returns {string} */
export function labelText(label) {
  const plate = /^force on plate (\d+)$/.exec(label);
  return plate ? translate("force on plate %(index)s", { index: plate[1] }) : translate(label).replaceAll("_", " ");
}

// Everything with a name that is drawn; a force is named at its head, with its size.
/** @param {Instant} instant @returns {Named[]} */
export function namedPlaces({ values, points, arrows, arrowMPerN, isHidden }) {
  const read = (/** @type {number} */ k) => [0, 1, 2].map((i) => values[k + i]);
  const places = points
    .filter(([name, , label]) => label && !isHidden(name))
    .map(([, k, label]) => ({ text: labelText(label), at: read(k) }));
  for (const [shaft, , k, label] of arrows) {
    if (!label || isHidden(shaft)) continue;
    const force = read(k + 3),
      size = Math.hypot(...force);
    if (!(size * arrowMPerN > 1e-3)) continue;
    const newtons = label.includes("force") ? `: ${size.toFixed(0)} N` : "";
    places.push({ text: labelText(label) + newtons, at: read(k).map((x, i) => x + force[i] * arrowMPerN) });
  }
  return places.filter(({ at }) => at.every(Number.isFinite));
}

// The name nearest to a pointer, and its place in pixels; null if none is within reach.
/** @param {Named[]} places @param {number[]} pointer @param {(at: number[]) => number[] | null} project */
export function nearestName(places, pointer, project) {
  /** @type {{ text: string, pixel: number[] } | null} */
  let nearest = null;
  let gap = REACH_PX;
  for (const { text, at } of places) {
    const pixel = project(at);
    if (!pixel) continue;
    const away = Math.hypot(pixel[0] - pointer[0], pixel[1] - pointer[1]);
    if (away < gap) {
      nearest = { text, pixel };
      gap = away;
    }
  }
  return nearest;
}

export class HoverNames {
  /** @param {HTMLElement} stage @param {any} iframe @param {any} scene @param {any} camera */
  constructor(stage, iframe, scene, camera) {
    this.scene = scene;
    this.camera = camera;
    this.iframe = iframe;
    /** @type {number[] | null} */
    this.pointer = null;
    this.isPending = false;
    this.tag = document.createElement("div");
    this.tag.className = "hover-name";
    this.tag.hidden = true;
    stage.append(this.tag);
    const inside = iframe.contentDocument;
    inside?.addEventListener("pointermove", (/** @type {PointerEvent} */ event) =>
      this.pointTo(event.buttons || event.pointerType === "touch" ? null : [event.clientX, event.clientY]),
    );
    for (const name of ["pointerdown", "wheel"]) inside?.addEventListener(name, () => this.pointTo(null), true);
    inside?.documentElement.addEventListener("pointerleave", () => this.pointTo(null));
  }

  /** @param {number[] | null} pointer */
  pointTo(pointer) {
    this.pointer = pointer;
    if (this.isPending) return;
    this.isPending = true;
    requestAnimationFrame(() => {
      this.isPending = false;
      this.update();
    });
  }

  // To be called after another instant was drawn, too.
  update() {
    if (!this.pointer && this.tag.hidden) return;
    const { layout, row, nodes } = this.scene;
    const places = namedPlaces({
      values: row,
      points: layout.points,
      arrows: layout.arrows,
      arrowMPerN: layout.arrow_m_per_n,
      isHidden: (name) => nodes.isHidden(name),
    });
    const nearest = this.pointer && nearestName(places, this.pointer, (at) => this.project(at));
    this.tag.hidden = !nearest;
    if (!nearest) return;
    this.tag.textContent = nearest.text;
    const [x, y] = nearest.pixel;
    this.tag.style.transform = `translate(${Math.round(x)}px, ${Math.round(y)}px) translate(-50%, calc(-100% - 10px))`;
  }

  /** @param {number[]} at */
  project(at) {
    const place = this.camera.toViserFrame(at).project(this.camera.viser.camera);
    if (place.z > 1) return null;
    return [((place.x + 1) / 2) * this.iframe.clientWidth, ((1 - place.y) / 2) * this.iframe.clientHeight];
  }
}
