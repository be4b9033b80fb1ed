// Corrects the contacts of the card of one's own robot in 3D: a click chooses a link or a contact, corners of a sole are
// dragged, and all of it can be typed.
import { call } from "../shared/api.js";
import { createElement } from "../shared/elements.js";
import { conjugate, multiply, rotate } from "./quaternions.js";

/** @typedef {{ frame: string, kind: string, position_m: number[], orientation_wxyz: number[],
 *   contact_half_size_m?: number[] | null, ankle?: string[] | null }} CardContact */
/** @typedef {{ position: number[], wxyz: number[] }} Pose */

const SVG = "http://www.w3.org/2000/svg";
const CORNERS = [
  [1, 1],
  [-1, 1],
  [-1, -1],
  [1, -1],
];
const AT_LINK = { position_m: [0, 0, 0], orientation_wxyz: [1, 0, 0, 0] }; // what a card leaves out
const CLICK_PX = 4,
  HANDLE_PX = 7,
  LEAST_M = 0.005;
const NAMES = ["left_foot", "right_foot", "left_hand", "right_hand"];
const isFoot = (/** @type {string} */ name) => name.endsWith("_foot");
const inWords = (/** @type {string} */ name) => name.replaceAll("_", " ");
const rounded = (/** @type {number[]} */ values, digits = 4) => values.map((v) => Number(v.toFixed(digits)));

// The pose `inner`, which is given in the frame of `outer`, in that of the world.
/** @param {Pose} outer @param {Pose} inner @returns {Pose} */
export function composePoses(outer, inner) {
  const moved = rotate(outer.wxyz, inner.position);
  return { position: moved.map((v, i) => v + outer.position[i]), wxyz: multiply(outer.wxyz, inner.wxyz) };
}

// The pose `world` in the frame of `outer`.
/** @param {Pose} outer @param {Pose} world @returns {Pose} */
export function relativePose(outer, world) {
  const back = conjugate(outer.wxyz);
  const apart = world.position.map((v, i) => v - outer.position[i]);
  return { position: rotate(back, apart), wxyz: multiply(back, world.wxyz) };
}

// The contact whose corner `k` is at `to`, in its own frame, while the opposite corner stays.
/** @param {CardContact} contact @param {number} k @param {number[]} to @returns {CardContact} */
export function withCorner(contact, k, to) {
  const half = contact.contact_half_size_m ?? [LEAST_M, LEAST_M];
  const fixed = [0, 1].map((i) => -CORNERS[k][i] * half[i]);
  const sizes = [0, 1].map((i) => Math.max(Math.abs(to[i] - fixed[i]) / 2, LEAST_M));
  const middle = [...[0, 1].map((i) => fixed[i] + CORNERS[k][i] * sizes[i]), 0];
  const shift = rotate(contact.orientation_wxyz, middle);
  return {
    ...contact,
    contact_half_size_m: rounded(sizes),
    position_m: rounded(contact.position_m.map((v, i) => v + shift[i])),
  };
}

export class CardContacts {
  /** @param {any} panel @param {HTMLElement} stage @param {import("./viser_nodes.js").ViserNodes} nodes */
  constructor(panel, stage, nodes) {
    this.panel = panel;
    this.nodes = nodes;
    this.frame = nodes.frame;
    this.address = `/robots/${encodeURIComponent(panel.dataset.robot)}/card`;
    this.links = JSON.parse(panel.dataset.links);
    this.chosen = "left_foot";
    /** @type {{ link: string, at: number[] | null }} */
    this.clicked = { link: "", at: null };
    this.view = "";
    this.overlay = document.createElementNS(SVG, "svg");
    this.overlay.classList.add("card-contacts");
    this.overlay.setAttribute("aria-hidden", "true"); // the fields say and change the same
    stage.append(this.overlay);
    this.field("contact").addEventListener("change", () => this.choose(this.field("contact").value));
    this.field("clicked").addEventListener("change", () => this.assign(this.field("clicked").value));
    panel.querySelector("[data-save-card]").addEventListener("click", () => this.save());
  }

  async start() {
    this.card = (await call("GET", this.address)).card;
    for (const [name, contact] of Object.entries(this.contacts))
      this.contacts[name] = { ...structuredClone(AT_LINK), ...contact };
    this.panel.hidden = false;
    this.field("contact").append(...NAMES.map((name) => new Option(inWords(name), name)));
    this.field("clicked").append(new Option("no contact", ""), ...NAMES.map((name) => new Option(inWords(name), name)));
    this.listen();
    this.choose(this.chosen);
    const follow = () => {
      this.draw();
      requestAnimationFrame(follow);
    };
    follow();
  }

  /** @param {string} name */
  field(name) {
    return this.panel.querySelector(`[name="${name}"]`);
  }

  /** @param {string} text */
  say(text) {
    this.panel.querySelector("[data-said]").textContent = text;
  }

  /** @returns {Record<string, CardContact>} */
  get contacts() {
    return this.card.effectors;
  }

  /** @param {string} link @returns {Pose | null} */
  poseOf(link) {
    const pose = this.nodes.viser.nodePoseData[`/robot/${link}`];
    return pose ? { position: [...pose.position], wxyz: [...pose.wxyz] } : null;
  }

  // Pose of a contact in the world; null without it, or on a link that is not drawn.
  /** @param {string} name */
  placeOf(name) {
    const contact = this.contacts[name],
      link = contact && this.poseOf(contact.frame);
    return link && composePoses(link, { position: contact.position_m, wxyz: contact.orientation_wxyz });
  }

  // A click that turns nothing chooses the link below the pointer; the frame has its own window.
  listen() {
    const inside = this.frame.contentDocument;
    /** @type {number[] | null} */
    let pressed = null;
    inside.addEventListener("pointerdown", (/** @type {PointerEvent} */ event) => {
      pressed = [event.clientX, event.clientY];
    });
    inside.addEventListener("pointerup", (/** @type {PointerEvent} */ event) => {
      const isClick = pressed && Math.hypot(event.clientX - pressed[0], event.clientY - pressed[1]) < CLICK_PX;
      pressed = null;
      if (isClick) this.pick([event.clientX, event.clientY]);
    });
  }

  /** @param {number[]} pixel */
  onScreen([x, y]) {
    return { x: (2 * x) / this.frame.clientWidth - 1, y: 1 - (2 * y) / this.frame.clientHeight };
  }

  // Chooses the link that is drawn at a pixel.
  /** @param {number[]} pixel */
  pick(pixel) {
    const { viser } = this.nodes,
      { raycaster } = /** @type {any} */ (this.nodes.root);
    raycaster.setFromCamera(this.onScreen(pixel), viser.camera);
    const links = new Map(
      this.links.map((/** @type {string} */ link) => [viser.nodeRefFromName[`/robot/${link}`], link]),
    );
    for (const hit of raycaster.intersectObject(viser.nodeRefFromName["/robot"], true)) {
      let node = hit.object;
      while (node && !links.has(node)) node = node.parent;
      if (!node) continue;
      const at = viser.nodeRefFromName[""].worldToLocal(hit.point.clone());
      this.pickLink(String(links.get(node)), [at.x, at.y, at.z]);
      return;
    }
  }

  /** @param {string} link @param {number[] | null} at */
  pickLink(link, at) {
    this.clicked = { link, at };
    const own = NAMES.find((name) => this.contacts[name]?.frame === link) ?? "";
    this.panel.querySelector("[data-clicked]").hidden = false;
    this.panel.querySelector("[data-link]").textContent = link;
    this.field("clicked").value = own;
    if (own) this.choose(own);
    this.view = "";
  }

  /** @param {string} name */
  choose(name) {
    this.chosen = name;
    this.field("contact").value = name;
    this.showFields();
    this.view = "";
  }

  // Makes the clicked link the one of a contact, which stays where it is, or goes to where a hand's link was clicked.
  /** @param {string} name */
  assign(name) {
    const { link, at } = this.clicked;
    if (name === "") {
      const feet = NAMES.filter((each) => isFoot(each) && this.contacts[each]?.frame === link);
      if (feet.length) {
        this.field("clicked").value = feet[0];
        this.say("A robot walks on two soles: click the link that has this one.");
        return;
      }
      for (const each of NAMES) if (this.contacts[each]?.frame === link) delete this.contacts[each];
    } else this.move(name, link, isFoot(name) ? null : at);
    this.changed();
    this.choose(name || this.chosen);
  }

  /** @param {string} name @param {string} link @param {number[] | null} at */
  move(name, link, at) {
    const pose = this.poseOf(link);
    if (!pose) return;
    const before = this.placeOf(name) ?? { position: at ?? pose.position, wxyz: [1, 0, 0, 0] };
    const { position, wxyz } = relativePose(pose, { ...before, position: at ?? before.position });
    this.contacts[name] = {
      ...(this.contacts[name] ?? { kind: "point" }),
      frame: link,
      position_m: rounded(position),
      orientation_wxyz: rounded(wxyz, 9),
    };
  }

  changed() {
    this.panel.querySelector("[data-save-card]").disabled = false;
    this.say("Changed, not saved.");
    this.view = "";
  }

  // The fields of the chosen contact; a hand that has none is given its link first.
  showFields() {
    const contact = this.contacts[this.chosen],
      fields = this.panel.querySelector("[data-contact-fields]");
    const link = createElement("select", { ariaLabel: "Link" });
    link.append(new Option("none", ""), ...this.links.map((/** @type {string} */ one) => new Option(one, one)));
    if (contact && !this.links.includes(contact.frame)) link.append(new Option(contact.frame, contact.frame));
    link.value = contact?.frame ?? "";
    link.addEventListener("change", () => {
      this.clicked = { link: link.value || (contact?.frame ?? ""), at: null };
      this.assign(link.value ? this.chosen : "");
      this.showFields();
    });
    const rows = [createElement("label", {}, "Link ", link)];
    const add = (/** @type {string} */ text, /** @type {number[]} */ values, /** @type {number} */ i, least = "") => {
      const input = createElement("input", { type: "number", step: "0.001", min: least, value: String(values[i]) });
      input.addEventListener("change", () => {
        if (!input.checkValidity() || input.value === "") return;
        values[i] = Number(input.value);
        this.changed();
      });
      rows.push(createElement("label", {}, text, input));
    };
    if (contact) {
      const half = contact.contact_half_size_m;
      if (half) for (const i of [0, 1]) add(["Half length (m) ", "Half width (m) "][i], half, i, String(LEAST_M));
      for (const i of [0, 1, 2]) add(`${"xyz"[i]} in the link (m) `, contact.position_m, i);
    }
    fields.replaceChildren(...rows);
  }

  // Places of the world in pixels of the stage; null behind the camera.
  /** @param {number[]} place */
  project([x, y, z]) {
    const { viser } = this.nodes;
    const seen = /** @type {any} */ (
      viser.nodeRefFromName[""].localToWorld(viser.camera.position.clone().set(x, y, z))
    ).project(viser.camera);
    if (seen.z > 1) return null;
    return [((seen.x + 1) / 2) * this.frame.clientWidth, ((1 - seen.y) / 2) * this.frame.clientHeight];
  }

  // Draws the contacts over the scene, if something has moved.
  draw() {
    const { viser } = this.nodes;
    if (!viser?.camera) return;
    const { clientWidth, clientHeight } = this.frame;
    const view = [
      .../** @type {any} */ (viser.camera).matrixWorld.elements,
      viser.camera.aspect,
      clientWidth,
      clientHeight,
    ]
      .map((v) => v.toFixed(4))
      .join();
    if (view === this.view || this.grip) return;
    this.view = view;
    this.overlay.setAttribute("viewBox", `0 0 ${clientWidth} ${clientHeight}`);
    this.overlay.replaceChildren(...NAMES.flatMap((name) => this.marksOf(name)), ...this.clickedMark());
  }

  /** @param {string} name */
  cornersOf(name) {
    const place = this.placeOf(name),
      half = this.contacts[name]?.contact_half_size_m;
    if (!place) return [];
    const own = half ? CORNERS.map(([i, j]) => [i * half[0], j * half[1], 0]) : [[0, 0, 0]];
    return own.map((at) => this.project(composePoses(place, { position: at, wxyz: [1, 0, 0, 0] }).position));
  }

  /** @param {string} name */
  marksOf(name) {
    const corners = this.cornersOf(name);
    if (!corners.length || corners.some((pixel) => !pixel)) return [];
    const pixels = /** @type {number[][]} */ (corners),
      isChosen = name === this.chosen;
    const mark =
      pixels.length === 1
        ? shape("circle", { cx: pixels[0][0], cy: pixels[0][1], r: HANDLE_PX })
        : shape("polygon", { points: pixels.map((pixel) => pixel.join()).join(" ") });
    mark.dataset.contact = name;
    mark.classList.toggle("chosen", isChosen);
    mark.addEventListener("click", () => {
      this.pickLink(this.contacts[name].frame, null);
      this.choose(name);
    });
    if (!isChosen || pixels.length === 1) return [mark];
    return [mark, ...pixels.map(([cx, cy], k) => this.handleOf(name, k, cx, cy))];
  }

  /** @param {string} name @param {number} k @param {number} cx @param {number} cy */
  handleOf(name, k, cx, cy) {
    const handle = shape("circle", { cx, cy, r: HANDLE_PX });
    handle.dataset.corner = String(k);
    handle.classList.add("corner");
    handle.addEventListener("pointerdown", (event) => {
      handle.setPointerCapture(event.pointerId);
      this.grip = { name, k };
    });
    handle.addEventListener("pointermove", (event) => {
      if (!this.grip) return;
      const at = this.onPlane(name, event);
      if (at) this.contacts[name] = withCorner(this.contacts[name], k, at);
      for (const [i, pixel] of this.cornersOf(name).entries()) {
        if (!pixel) continue;
        const moved = this.overlay.querySelector(`[data-corner="${i}"]`);
        moved?.setAttribute("cx", String(pixel[0]));
        moved?.setAttribute("cy", String(pixel[1]));
      }
      this.overlay.querySelector(`[data-contact="${name}"]`)?.setAttribute(
        "points",
        this.cornersOf(name)
          .map((pixel) => pixel?.join() ?? "")
          .join(" "),
      );
    });
    handle.addEventListener("lostpointercapture", () => {
      this.grip = null;
      this.changed();
      this.showFields();
    });
    return handle;
  }

  // Where the pointer is on the plane of a contact, in the contact's frame; null where the plane is seen edge on.
  /** @param {string} name @param {PointerEvent} event */
  onPlane(name, event) {
    const { viser } = this.nodes,
      place = this.placeOf(name),
      box = this.overlay.getBoundingClientRect();
    if (!place) return null;
    const { x, y } = this.onScreen([event.clientX - box.left, event.clientY - box.top]);
    const toWorld = (/** @type {any} */ vector) => {
      const at = viser.nodeRefFromName[""].worldToLocal(vector);
      return [at.x, at.y, at.z];
    };
    const eye = toWorld(viser.camera.position.clone()),
      through = toWorld(/** @type {any} */ (viser.camera.position.clone().set(x, y, 0.5)).unproject(viser.camera));
    const [from, to] = [eye, through].map((position) => relativePose(place, { position, wxyz: [1, 0, 0, 0] }).position);
    const share = from[2] / (from[2] - to[2]);
    return share > 0 && Number.isFinite(share) ? [0, 1].map((i) => from[i] + share * (to[i] - from[i])) : null;
  }

  clickedMark() {
    const { link, at } = this.clicked,
      pixel = at && this.project(at);
    if (!pixel) return [];
    const text = shape("text", { x: pixel[0] + 12, y: pixel[1] - 8 });
    text.textContent = link;
    return [shape("circle", { cx: pixel[0], cy: pixel[1], r: 3 }), text];
  }

  async save() {
    try {
      await call("PUT", this.address, this.card);
      location.reload();
    } catch (error) {
      this.say(/** @type {Error} */ (error).message);
    }
  }
}

/** @param {string} name @param {Record<string, string | number>} attributes @returns {SVGElement} */
function shape(name, attributes) {
  const made = /** @type {SVGElement} */ (document.createElementNS(SVG, name));
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, String(value));
  return made;
}
