// A scenario in 3D beside the list of its contacts: drag, type or press arrow keys; one place stores and undoes.
import { call } from "./api.js";
import { Nodes } from "./nodes.js";
import { offerPlan } from "./plan.js";

const WATCH_MS = 100, AFTER_KEYS_MS = 500, NUDGE_M = 0.01, FINE_M = 0.001, DRAGGED_M = 1e-4, CHOSEN = 1.3;
const TURN = "/turn"; // the viewer moves it after every drag (viewer/scenario_scene.py)
const BODY = ["name", "description", "robot", "friction", "start_com_height_m", "terrain", "phases"];
// Arrow keys as seen from behind the robot: x points forward, y to its left.
const NUDGES = { ArrowUp: [1, 0], ArrowDown: [-1, 0], ArrowLeft: [0, 1], ArrowRight: [0, -1] };

const root = document.querySelector("[data-editor]");
const part = (name) => root.querySelector(`[data-${name}]`);
const [stage, list, said, undo] = ["stage", "touches", "said", "undo"].map(part);
const frame = stage.querySelector("iframe");
const scene = stage.dataset.scene, id = root.dataset.scenario, own = root.dataset.own === "true";

let touches = [], nodes = null, chosen = null, attempts = 0, work = Promise.resolve(), pending = null;
const rows = new Map(), past = [];

start().catch((error) => {
  part("veil").hidden = false;
  part("veil").textContent = error.message;
});
offerPlan(root, id, { before: flush });

async function start() {
  touches = await getJson(`${scene}/touches.json`);
  for (const touch of touches) addRow(touch);
  await getJson(`${scene}/open`, { method: "POST" });
  nodes = new Nodes(frame, [TURN, ...touches.map((touch) => touch.node)]);
  frame.src = `${scene}/?hideViserLogo&fixedDpr=1`;
  frame.hidden = false;
  await nodes.ready();
  attempts = nodes.position(TURN)?.[0] ?? 0;
  part("veil").hidden = true;
  show();
  root.dataset.ready = "true";
  setInterval(watch, WATCH_MS);
}

async function getJson(url, options) {
  const answer = await fetch(url, options).catch(() => null);
  const value = await answer?.json().catch(() => null);
  if (answer?.ok && value) return value;
  throw new Error(value?.detail || "The scene could not be read.");
}

function addRow(touch) {
  const row = root.querySelector("template[data-row]").content.firstElementChild.cloneNode(true);
  const find = (name) => row.querySelector(`[data-${name}]`);
  find("dot").classList.add(touch.side);
  find("number").textContent = touch.number;
  find("name").textContent = touch.effector.replaceAll("_", " ");
  find("yaw").hidden = !touch.surface;
  const [first, last] = touch.phases;
  find("when").textContent = `${first === last ? `Phase ${first}` : `Phases ${first} to ${last}`}, ${touch.start_s.toFixed(2)} s to ${touch.end_s.toFixed(2)} s`;
  const button = row.querySelector("button");
  button.addEventListener("click", () => choose(chosen === touch.number ? null : touch.number));
  button.addEventListener("keydown", (event) => nudge(event, touch.number));
  for (const input of row.querySelectorAll("input")) {
    input.disabled = !own;
    input.addEventListener("change", () => typed(touch.number, input));
  }
  rows.set(touch.number, row);
  list.append(row);
}

const touchOf = (number) => touches.find((touch) => touch.number === number);

function choose(number) {
  chosen = number;
  for (const [other, row] of rows) {
    row.querySelector("button").setAttribute("aria-expanded", String(other === number));
    row.querySelector(".numbers").hidden = other !== number;
  }
  if (number !== null) rows.get(number).scrollIntoView({ block: "nearest" });
  halo();
}

function halo() {
  if (!nodes?.viser) return;
  for (const touch of touches) nodes.scale(`${touch.node}/edge`, touch.number === chosen ? CHOSEN : 1);
  nodes.viser.requestRender();
}

// Writes a place into a row; a number that is being typed stays.
function write(touch, position) {
  const row = rows.get(touch.number);
  row.querySelector("[data-place]").textContent = position.map((v) => v.toFixed(3)).join(", ");
  const values = { x: position[0], y: position[1], z: position[2], yaw: touch.yaw_deg };
  for (const input of row.querySelectorAll("input")) {
    const text = String(Number(values[input.name].toFixed(input.name === "yaw" ? 1 : 4)));
    if (document.activeElement !== input && input.value !== text) input.value = text;
  }
}

function show() {
  for (const touch of touches) {
    if (pending?.number === touch.number && !pending.sent) continue; // the keys are ahead
    write(touch, touch.position_m);
    nodes?.viser && nodes.pose(touch.node, [...touch.position_m], [...touch.orientation_wxyz]);
  }
  halo();
  if (undo) undo.disabled = past.length === 0;
}

// The viewer moves a mark while it is dragged; the list follows, and reads anew what was stored when it is released.
function watch() {
  nodes.find();
  const turn = nodes.position(TURN)?.[0] ?? 0;
  if (turn !== attempts) {
    attempts = turn;
    work = work.then(() => refresh(true));
    return;
  }
  if (pending) return;
  for (const touch of touches) {
    const now = nodes.position(touch.node);
    if (now && distance(now, touch.position_m) > DRAGGED_M) {
      if (chosen !== touch.number) choose(touch.number);
      write(touch, now);
    }
  }
}

async function refresh(dragged) {
  try {
    const opened = await getJson(`${scene}/open`, { method: "POST" });
    const before = touches;
    touches = await getJson(`${scene}/touches.json`);
    if (touches.length !== rows.size) return location.reload();
    if (dragged) {
      for (const [k, touch] of touches.entries()) if (distance(touch.position_m, before[k].position_m) > 1e-6) past.push(before[k]);
      say(opened.said || "Stored.", Boolean(opened.said));
    }
  } catch (error) {
    say(error.message, true);
  }
  show();
}

// Stores a touch at another place: in all phases in which it is there. What the service refuses goes back.
async function store(number, position_m, orientation_wxyz, remember = true) {
  const before = touchOf(number);
  const [first, last] = before.phases;
  let refusal = "";
  try {
    const stored = await call("GET", `/scenarios/${id}`);
    const body = Object.fromEntries(BODY.map((name) => [name, stored[name]]));
    for (const phase of body.phases.slice(first, last + 1)) {
      for (const contact of phase.contacts) if (contact.effector === before.effector) Object.assign(contact, { position_m, orientation_wxyz });
    }
    await call("PUT", `/scenarios/${id}`, body);
    if (remember) past.push(before);
  } catch (error) {
    refusal = error.message;
  }
  await refresh(false);
  say(refusal || `Contact ${number} stored.`, Boolean(refusal));
}

function typed(number, input) {
  const touch = touchOf(number), value = input.valueAsNumber;
  if (!Number.isFinite(value)) return show();
  const position = [...touch.position_m];
  let wxyz = touch.orientation_wxyz;
  if (input.name === "yaw") wxyz = turned(wxyz, ((value - touch.yaw_deg) * Math.PI) / 180);
  else position["xyz".indexOf(input.name)] = value;
  work = work.then(() => store(number, position, wxyz));
}

// The mark moves with each press; what it comes to is stored once the keys rest.
function nudge(event, number) {
  const by = NUDGES[event.key];
  if (!by || !own || !nodes?.viser || event.ctrlKey || event.metaKey || event.altKey) return;
  event.preventDefault();
  if (chosen !== number) choose(number);
  const touch = touchOf(number);
  if (pending && pending.number !== number) flush();
  const from = pending?.number === number ? pending.position : touch.position_m, step = event.shiftKey ? FINE_M : NUDGE_M;
  const position = [round(from[0] + step * by[0]), round(from[1] + step * by[1]), from[2]];
  clearTimeout(pending?.timer);
  pending = { number, position, timer: setTimeout(flush, AFTER_KEYS_MS) };
  write(touch, position);
  nodes.pose(touch.node, [...position]);
  nodes.viser.requestRender();
}

// Stores what the keys have moved; resolves when nothing is left to be stored.
function flush() {
  const now = pending;
  if (now && !now.sent) {
    clearTimeout(now.timer);
    now.sent = true;
    work = work
      .then(() => store(now.number, now.position, touchOf(now.number).orientation_wxyz))
      .then(() => {
        if (pending === now) pending = null;
      });
  }
  return work;
}

function goBack() {
  work = flush().then(async () => {
    const before = past.pop();
    if (before) await store(before.number, before.position_m, before.orientation_wxyz, false);
  });
}

undo?.addEventListener("click", goBack);
document.addEventListener("keydown", (event) => {
  if (!undo || event.key !== "z" || !(event.ctrlKey || event.metaKey) || event.target.tagName === "INPUT") return;
  event.preventDefault();
  goBack();
});

part("copy")?.addEventListener("click", async (event) => {
  const button = event.currentTarget;
  button.disabled = true;
  try {
    const stored = await call("GET", `/scenarios/${id}`);
    const body = Object.fromEntries(BODY.map((name) => [name, stored[name]]));
    const copy = await call("POST", "/scenarios", { ...body, name: `${body.name.slice(0, 100)} (copy)` });
    location.assign(`/view/?scenario=${encodeURIComponent(copy.id)}`);
  } catch (error) {
    say(error.message, true);
    button.disabled = false;
  }
});

function say(text, wrong) {
  said.textContent = text;
  said.classList.toggle("wrong", wrong);
}

const distance = (a, b) => Math.hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]);
const round = (v) => Math.round(v * 1e4) / 1e4;

// A turn about the vertical, after the orientation that is there.
function turned([w, x, y, z], angle_rad) {
  const c = Math.cos(angle_rad / 2), s = Math.sin(angle_rad / 2);
  return [c * w - s * z, c * x - s * y, c * y + s * x, c * z + s * w];
}
