// The 3D scene of a scenario as its editor uses it: nodes that come and go, what is held there, and news from others.
import { widen } from "../viewer/camera.js";
import { LIVE } from "./live_preview_view.js";
import { Nodes } from "../viewer/viser_nodes.js";
import { Pixels } from "../viewer/adaptive_resolution.js";
import { Room } from "../viewer/dark_mode.js";
import { contactIn } from "./phase_edits.js";
import { SUPPORT } from "./support_overlay.js";

const TURN = "/turn"; // the viewer moves it after every drag and every change from elsewhere (viewer/scenario_scene.py)
const DRAGGED_M = 1e-4,
  LETS_GO_MS = 1000,
  STORED_WITHIN_MS = 3000;

export class Picture {
  constructor(stage) {
    this.frame = stage.querySelector("iframe");
    this.scene = stage.dataset.scene;
    this.turn = 0;
    this.pressed = false;
    this.released_ms = -Infinity;
    this.mine = false;
    this.nodes = new Nodes(this.frame, []);
  }

  get there() {
    return Boolean(this.nodes.viser);
  }

  // Brings the scene up to date; why the last drag in it was refused, or an empty text.
  async open() {
    return (await this.ask("open", { method: "POST" })).said;
  }

  touches() {
    return this.ask("touches.json");
  }

  async ask(name, options) {
    const answer = await fetch(`${this.scene}/${name}`, options).catch(() => null);
    const value = await answer?.json().catch(() => null);
    if (answer?.ok && value) return value;
    throw new Error(value?.detail || "The scene could not be read.");
  }

  // Waits for the scene; `shortcuts` work in it, too.
  async load(touches, body, shortcuts) {
    this.shortcuts = shortcuts;
    this.around = aroundOf(body);
    await this.fit(touches, body);
    new Room(this.nodes);
    new Pixels(this.nodes);
    widen(this.nodes.viser);
    this.turn = this.nodes.position(TURN)?.[0] ?? 0;
    this.listen();
  }

  // Waits for the nodes of these touches; another terrain or robot needs the scene anew.
  async fit(touches, body) {
    const around = aroundOf(body),
      anew = around !== this.around;
    this.around = around;
    this.nodes.names = [TURN, ...SUPPORT, ...LIVE, ...touches.map((touch) => touch.node)];
    if (anew) this.nodes.reload();
    await this.nodes.ready();
    if (!anew) return;
    this.listen();
    new Room(this.nodes);
    new Pixels(this.nodes);
    widen(this.nodes.viser);
  }

  listen() {
    const inside = this.frame.contentWindow;
    const press = (on) => () => {
      if (this.pressed && !on) this.released_ms = performance.now();
      this.pressed = on;
    };
    inside.addEventListener("pointerdown", press(true), true);
    for (const name of ["pointerup", "pointercancel"]) inside.addEventListener(name, press(false), true);
    this.shortcuts.enter(this.frame);
  }

  // Whether something has been stored, or refused, since it was asked last; `mine` where it was dragged here.
  news() {
    this.nodes.find();
    const turn = this.nodes.position(TURN)?.[0] ?? this.turn;
    if (turn === this.turn) return null;
    this.turn = turn;
    // A drag that was over between two looks is known by the press alone.
    const mine = this.mine || this.pressed || performance.now() - this.released_ms < STORED_WITHIN_MS;
    this.mine = false;
    return { mine };
  }

  // The touch whose mark is being dragged here away from where it is in `body`, and where to; null where there is none.
  held(touches, body) {
    if (!this.pressed && performance.now() - this.released_ms > LETS_GO_MS) return null;
    for (const touch of touches) {
      const at = this.nodes.position(touch.node),
        given = contactIn(body, touch.phases[0], touch.effector);
      if (!at || !given || Math.hypot(...at.map((v, i) => v - given.position_m[i])) <= DRAGGED_M) continue;
      this.mine = true;
      return { touch, position_m: [...at] };
    }
    return null;
  }
}

const aroundOf = (body) => JSON.stringify([body.terrain, body.robot]);
