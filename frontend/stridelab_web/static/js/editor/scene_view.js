// The 3D scene of the scenario editor: waits for its nodes, reports drags and changes that were stored elsewhere.
import { fitWidth } from "../viewer/camera.js";
import { PREVIEW_NODES } from "./live_preview.js";
import { ViserNodes } from "../viewer/viser_nodes.js";
import { AdaptiveResolution } from "../viewer/adaptive_resolution.js";
import { DarkMode } from "../viewer/dark_mode.js";
import { fetchChecked } from "../shared/api.js";
import { contactOf } from "./phase_edits.js";
import { PLUMB_NODE, SUPPORT_NODES } from "./support_overlay.js";

const REVISION_NODE = "/turn"; // the viewer moves it after every drag and every stored change (viewer/scenario_scene.py)
const MIN_DRAG_M = 1e-4,
  RELEASE_MS = 1000,
  STORED_WITHIN_MS = 3000;

const HELD = "/held"; // the place of a dragged contact of a read-only scenario, and that its drag has ended
const HELD_ENDED = `${HELD}/ended`;

export class SceneView {
  /** @param {PageElement} stage */
  constructor(stage) {
    this.frame = stage.querySelector("iframe");
    this.scene = stage.dataset.scene;
    this.revision = 0;
    this.isPressed = false;
    this.released_ms = -Infinity;
    this.isOwnChange = false;
    this.isHandled = false; // the held contact was released, and the page has stored it
    this.nodes = new ViserNodes(this.frame, []);
  }

  get isReady() {
    return Boolean(this.nodes.viser);
  }

  // Updates the scene to the stored scenario. Returns the reason why the last drag was refused, or an empty string.
  async synchronise() {
    return (await this.request("open", { method: "POST" })).said;
  }

  readTouches() {
    return this.request("touches.json");
  }

  /** @param {string} name @param {RequestInit} [options] */
  async request(name, options) {
    return (await fetchChecked(`${this.scene}/${name}`, options)).json();
  }

  // Waits for the scene and enables `shortcuts` in it.
  /**
   * @param {Touch[]} touches
   * @param {Scenario} scenario
   * @param {import("../shared/shortcuts.js").Shortcuts} shortcuts
   */
  async start(touches, scenario, shortcuts) {
    this.shortcuts = shortcuts;
    this.environment = environmentKey(scenario);
    await this.update(touches, scenario);
    this.attach();
    this.revision = this.nodes.positionOf(REVISION_NODE)?.[0] ?? 0;
  }

  // Waits for the nodes of these touches; another terrain or robot reloads the scene.
  /** @param {Touch[]} touches @param {Scenario} scenario */
  async update(touches, scenario) {
    const environment = environmentKey(scenario),
      reload = environment !== this.environment;
    this.environment = environment;
    this.nodes.names = [REVISION_NODE, ...SUPPORT_NODES, ...PREVIEW_NODES, ...touches.map((touch) => touch.node)];
    if (reload) this.nodes.reload();
    await this.nodes.ready();
    if (reload) this.attach();
  }

  // What a scene that was loaded needs.
  attach() {
    new DarkMode(this.nodes, [...PREVIEW_NODES, PLUMB_NODE]);
    new AdaptiveResolution(this.nodes);
    fitWidth(this.nodes.viser);
    this.listenForPresses();
  }

  listenForPresses() {
    const inside = this.frame.contentWindow;
    const press = (/** @type {boolean} */ on) => () => {
      if (this.isPressed && !on) this.released_ms = performance.now();
      this.isPressed = on;
    };
    inside.addEventListener("pointerdown", press(true), true);
    for (const name of ["pointerup", "pointercancel"]) inside.addEventListener(name, press(false), true);
    this.shortcuts?.listenInFrame(this.frame);
  }

  // Whether something was stored or refused since the last call, else null; `isOwnChange` if by a drag in this page.
  takeChange() {
    this.nodes.refreshClient();
    const revision = this.nodes.positionOf(REVISION_NODE)?.[0] ?? this.revision;
    if (revision === this.revision) return null;
    this.revision = revision;
    // A drag that began and ended between two calls is recognised by the press of the pointer alone.
    const isOwnChange = this.isOwnChange || this.isPressed || performance.now() - this.released_ms < STORED_WITHIN_MS;
    this.isOwnChange = false;
    return { isOwnChange };
  }

  // The touch whose mark is dragged away from its position in `scenario`, and the new position; null without a drag.
  /** @param {Touch[]} touches @param {Scenario} scenario */
  draggedContact(touches, scenario) {
    if (!this.isPressed && performance.now() - this.released_ms > RELEASE_MS) return null;
    for (const touch of touches) {
      const position = this.nodes.positionOf(touch.node),
        stored = contactOf(scenario, touch);
      if (!position || !stored || Math.hypot(...position.map((v, i) => v - stored.position_m[i])) <= MIN_DRAG_M)
        continue;
      this.isOwnChange = true;
      return { touch, position_m: [...position], isReleased: false };
    }
    return null;
  }

  // The same of a read-only scenario, in which the viewer moves no mark, because others see the same scene; `isReleased` is
  // true once at the end of the drag, which the page has to store.
  /** @param {Touch[]} touches @param {Scenario} scenario */
  heldContact(touches, scenario) {
    const touch = touches.find(({ number }) => this.nodes.positionOf(`${HELD}/${number}`));
    const ended_m = touch ? this.nodes.positionOf(HELD_ENDED) : null,
      isReleased = ended_m !== null,
      isNew = !this.isHandled;
    this.isHandled = isReleased;
    if (!touch || !isNew) return null;
    const held_m = ended_m ?? /** @type {number[]} */ (this.nodes.positionOf(`${HELD}/${touch.number}`));
    const position_m = held_m.map((v) => Math.round(v * 1e4) / 1e4);
    const stored_m = contactOf(scenario, touch).position_m;
    const moved_m = Math.hypot(...position_m.map((v, i) => v - stored_m[i]));
    return moved_m > MIN_DRAG_M ? { touch, position_m, isReleased } : null;
  }
}

const environmentKey = (/** @type {Scenario} */ scenario) => JSON.stringify([scenario.terrain, scenario.robot]);
