// A scenario in 3D beside the list of its contacts: drag, type or press arrow keys; one place stores and undoes.
import { call } from "./api.js";
import { offerContacts } from "./find.js";
import { Judged } from "./judged.js";
import { LIVE, Live } from "./live.js";
import { Nodes } from "./nodes.js";
import { offerPlan } from "./plan.js";
import { Rows } from "./rows.js";
import { bodyOf, moved, openNew, turned } from "./scenario_body.js";
import { SUPPORT } from "./support_view.js";

const WATCH_MS = 100, AFTER_KEYS_MS = 500, NUDGE_M = 0.01, FINE_M = 0.001, DRAGGED_M = 1e-4;
const TURN = "/turn"; // the viewer moves it after every drag (viewer/scenario_scene.py)
// Arrow keys as seen from behind the robot: x points forward, y to its left.
const NUDGES = { ArrowUp: [1, 0], ArrowDown: [-1, 0], ArrowLeft: [0, 1], ArrowRight: [0, -1] };

const root = document.querySelector("[data-editor]");
const part = (name) => root.querySelector(`[data-${name}]`);
const [stage, said, undo] = ["stage", "said", "undo"].map(part);
const frame = stage.querySelector("iframe");
const scene = stage.dataset.scene, id = root.dataset.scenario, own = root.dataset.own === "true";
const toggle = (number) => choose(chosen === number ? null : number);
const rows = new Rows(root, own, { choose: toggle, nudge, preview, typed, left });
const judged = new Judged(root, rows);
const live = new Live(root);
const past = [];

// `body` is what is stored; `draft` is where a touch would be: dragged, typed or nudged, and not stored yet.
let touches = [], body = null, nodes = null, chosen = null, attempts = 0, work = Promise.resolve(), pending = null, draft = null;

start().catch((error) => {
  part("veil").hidden = false;
  part("veil").textContent = error.message;
});
offerPlan(root, id, flush);
offerContacts(root, id, flush);

async function start() {
  await read();
  for (const touch of touches) rows.add(touch);
  await getJson(`${scene}/open`, { method: "POST" });
  nodes = new Nodes(frame, [TURN, ...SUPPORT, ...LIVE, ...touches.map((touch) => touch.node)]);
  frame.src = `${scene}/?hideViserLogo&fixedDpr=1`;
  frame.hidden = false;
  await nodes.ready();
  attempts = nodes.position(TURN)?.[0] ?? 0;
  part("veil").hidden = true;
  show();
  live.start(nodes);
  root.dataset.ready = "true";
  setInterval(watch, WATCH_MS);
}

async function read() {
  touches = await getJson(`${scene}/touches.json`);
  body = bodyOf(await call("GET", `/scenarios/${id}`));
}

async function getJson(url, options) {
  const answer = await fetch(url, options).catch(() => null);
  const value = await answer?.json().catch(() => null);
  if (answer?.ok && value) return value;
  throw new Error(value?.detail || "The scene could not be read.");
}

const touchOf = (number) => touches.find((touch) => touch.number === number);

function choose(number) {
  chosen = number;
  rows.open(number);
  judged.look(nodes, touches, chosen);
}

function show() {
  draft = null;
  for (const touch of touches) {
    if (pending?.number === touch.number && !pending.sent) continue; // the keys are ahead
    rows.write(touch, touch.position_m);
    nodes.pose(touch.node, [...touch.position_m], [...touch.orientation_wxyz]);
  }
  judged.look(nodes, touches, chosen);
  nodes.draw();
  ask(body);
  if (undo) undo.disabled = past.length === 0;
}

// What is not stored yet: the judge is asked at once.
function propose(number, position_m, orientation_wxyz, typing = false) {
  draft = { number, position_m, typing };
  ask(moved(body, touchOf(number), position_m, orientation_wxyz));
}

// Judges and plans what is stored, or would be.
function ask(wanted) {
  judged.ask(wanted);
  live.follow(wanted);
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
  if (nodes.isStale()) return show();
  if (pending || draft?.typing) return;
  for (const touch of touches) {
    const now = nodes.position(touch.node);
    if (!now || distance(now, draft?.number === touch.number ? draft.position_m : touch.position_m) <= DRAGGED_M) continue;
    if (chosen !== touch.number) choose(touch.number);
    rows.write(touch, now);
    propose(touch.number, [...now], touch.orientation_wxyz);
  }
}

async function refresh(dragged) {
  try {
    const opened = await getJson(`${scene}/open`, { method: "POST" });
    const before = touches;
    await read();
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
  let refusal = "";
  try {
    const stored = await call("GET", `/scenarios/${id}`);
    await call("PUT", `/scenarios/${id}`, moved(bodyOf(stored), before, position_m, orientation_wxyz));
    if (remember) past.push(before);
  } catch (error) {
    refusal = error.message;
  }
  await refresh(false);
  say(refusal || `Contact ${number} stored.`, Boolean(refusal));
}

// Where the numbers of a row would put its touch; null while one of them is no number.
function placed(number, input) {
  const touch = touchOf(number), value = input.valueAsNumber;
  if (!Number.isFinite(value)) return null;
  const position = [...touch.position_m];
  if (input.name === "yaw") return [position, turned(touch.orientation_wxyz, ((value - touch.yaw_deg) * Math.PI) / 180)];
  position["xyz".indexOf(input.name)] = value;
  return [position, touch.orientation_wxyz];
}

function preview(number, input) {
  const place = placed(number, input);
  if (!place || !nodes?.viser) return;
  rows.write(touchOf(number), place[0]);
  nodes.pose(touchOf(number).node, [...place[0]], [...place[1]]);
  nodes.draw();
  propose(number, ...place, true);
}

function typed(number, input) {
  const place = placed(number, input);
  if (!place) return show();
  if (draft) draft.typing = false;
  work = work.then(() => store(number, ...place));
}

// A number that was typed and taken back is no change.
function left() {
  if (draft?.typing) show();
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
  rows.write(touch, position);
  nodes.pose(touch.node, [...position]);
  nodes.draw();
  propose(number, position, touch.orientation_wxyz);
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
    await openNew(bodyOf(await call("GET", `/scenarios/${id}`)), " (copy)");
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
