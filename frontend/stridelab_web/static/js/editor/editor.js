// A scenario in 3D beside its phases and the list of its contacts: drag, type or press keys; one place stores and undoes.
import { call } from "../shared/api.js";
import { offerContacts } from "./contact_planning.js";
import { JsonView } from "./json_view.js";
import { Judged } from "./validation_view.js";
import { Kept, same } from "./scenario_store.js";
import { Live } from "./live_preview.js";
import { PhaseForm } from "./phase_form.js";
import { Picture } from "./scene_view.js";
import { offerPlan } from "./motion_planning.js";
import { Rows } from "./contact_list.js";
import { bodyOf, moved, openNew } from "./scenario_requests.js";
import { contactIn } from "./phase_edits.js";
import { CAMERA_KEYS, Shortcuts } from "../shared/shortcuts.js";
import { Strip } from "./phase_timeline.js";
import { turned, yawOf } from "../viewer/quaternions.js";
import { failed, lift } from "../viewer/loading_overlay.js";

const WATCH_MS = 100,
  AFTER_KEYS_MS = 500,
  NUDGE_M = 0.01,
  FINE_M = 0.001,
  CHANGED = 412;
const ELSEWHERE = "Changed in another window: this is how it stands now. Undo takes that back, too.";
const NOT_OURS = "Meanwhile it was changed in another window, so this was not stored. Here is how it stands now.";
// Arrow keys as seen from behind the robot: x points forward, y to its left.
const NUDGES = { ArrowUp: [1, 0], ArrowDown: [-1, 0], ArrowLeft: [0, 1], ArrowRight: [0, -1] };

const root = document.querySelector("[data-editor]");
const part = (name) => root.querySelector(`[data-${name}]`);
const [said, undo, redo] = ["said", "undo", "redo"].map(part);
const id = root.dataset.scenario,
  own = root.dataset.own === "true";
const kept = new Kept(id);
const picture = new Picture(part("stage"));
const rows = new Rows(root, own, { choose: toggle, nudge, preview, typed, left });
const form = new PhaseForm(root, own, { change, propose: (edit) => propose(edit, { typing: true }), back: left });
const strip = new Strip(root, own, {
  choose: choosePhase,
  touch: choose,
  toggle: (k, effector) => form.toggle(k, effector),
  propose,
  settle: change,
  later,
  back,
});
const judged = new Judged(root, rows, strip, (k) => form.show(now(), k));
const live = new Live(root);

// `draft` is what is being dragged, typed or nudged and not stored yet; `pending` what is stored once the keys rest.
let touches = [],
  /** @type {number | null} */ chosen = null,
  /** @type {{ body: any, held?: number, typing?: boolean } | null} */ draft = null,
  /** @type {{ key: string, edit: (body: any) => any, done: string, timer: number, sent?: boolean } | null} */ pending =
    null,
  /** @type {Promise<any>} */ work = Promise.resolve();
const now = () => draft?.body ?? kept.body;
const touchOf = (number) => touches.find((touch) => touch.number === number);

start().catch((error) => failed(part("stage"), error));
offerPlan(root, id, flush);
offerContacts(root, id, flush);
new JsonView(root, { read: () => now() ?? {}, store: storeWhole });

async function start() {
  await kept.read();
  touches = await picture.touches();
  rows.fill(touches);
  strip.draw(kept.body, touches);
  await picture.open();
  await picture.load(touches, kept.body, shortcuts);
  const wanted = new URLSearchParams(location.search),
    [number, phase] = ["contact", "phase"].map((name) => (wanted.has(name) ? Number(wanted.get(name)) : null));
  if (touchOf(number)) choose(number, false);
  if (phase !== null && phase in kept.body.phases) judged.choosePhase(phase);
  show();
  live.start(picture.nodes);
  await lift(part("stage"), picture.nodes);
  root.dataset.ready = "true";
  setInterval(watch, WATCH_MS);
}

// Which contact is open, and which phase is looked at, stay with a reload.
function remember(name, value) {
  const url = new URL(location.href);
  if (value === null) url.searchParams.delete(name);
  else url.searchParams.set(name, value);
  history.replaceState(null, "", url);
}

function toggle(number) {
  choose(chosen === number ? null : number);
}

function choose(number, noted = true) {
  chosen = number;
  rows.open(number);
  if (noted) remember("contact", number);
  judged.look(picture.nodes, touches, chosen);
}

function choosePhase(k) {
  judged.choosePhase(k);
  remember("phase", k);
}

// Shows what is stored, or would be; and asks what the judge and the planner think of it.
function show() {
  const body = now(),
    { nodes } = picture;
  for (const touch of touches) {
    const contact = contactIn(body, touch.phases[0], touch.effector);
    rows.write(touch, body);
    if (picture.there && draft?.held !== touch.number)
      nodes.pose(touch.node, [...contact.position_m], [...contact.orientation_wxyz]);
  }
  strip.draw(body, touches);
  form.show(body, judged.phase ?? 0);
  judged.look(nodes, touches, chosen);
  if (picture.there) nodes.draw();
  judged.ask(body);
  live.follow(body);
  if (undo) [undo.disabled, redo.disabled] = [kept.past.length === 0, kept.future.length === 0];
}

// `edit` on what is shown, without storing it.
function propose(edit, how = {}) {
  draft = { body: edit(kept.body), ...how };
  show();
}

// What is shown and was not stored goes back.
function back() {
  if (!draft || pending) return;
  draft = null;
  show();
}

// What was typed and not taken over is no change.
function left() {
  if (draft?.typing) back();
}

// The viewer moves a mark while it is dragged; the list follows, and reads anew what was stored when it is released.
function watch() {
  const news = picture.news();
  if (news) {
    work = work.then(() => hear(news));
    return;
  }
  if (picture.nodes.isStale()) return show();
  if (pending || draft?.typing || strip.held) return;
  const held = picture.held(touches, now());
  if (!held) return;
  const { touch, position_m } = held;
  if (chosen !== touch.number) choose(touch.number);
  propose((body) => moved(body, touch, position_m, contactIn(body, touch.phases[0], touch.effector).orientation_wxyz), {
    held: touch.number,
  });
}

async function hear({ mine }) {
  const changed = await kept.read().catch(() => false);
  if (!mine && !changed) return; // it was stored here
  const refusal = await refresh();
  if (mine) say(refusal || "Stored.", Boolean(refusal));
  else say(ELSEWHERE, true);
}

// Reads what is stored, and lets list and picture follow; what the keys are about to store stays ahead. Gives why a drag
// in the picture was refused, or an empty text.
async function refresh() {
  try {
    await kept.read();
    const refusal = await picture.open();
    touches = await picture.touches();
    if (!rows.fits(touches)) {
      const effector = touchOf(chosen)?.effector;
      rows.fill(touches);
      chosen = effector && touchOf(chosen)?.effector === effector ? chosen : null;
      if (chosen !== null) rows.open(chosen);
    }
    await picture.fit(touches, kept.body);
    draft = pending && !pending.sent ? { body: pending.edit(kept.body) } : null;
    show();
    return refusal;
  } catch (error) {
    show();
    return error.message;
  }
}

// Stores `edit` of what is stored then; what the service refuses goes back. Gives the failure, or null.
async function store(edit, done) {
  let failure = null;
  try {
    const body = edit(kept.body);
    if (!same(body, kept.body)) await kept.put(body);
  } catch (error) {
    failure = error;
  }
  await refresh();
  tell(failure, done);
  return failure;
}

function tell(failure, done) {
  say(failure ? (failure.status === CHANGED ? NOT_OURS : failure.message) : done, Boolean(failure));
}

function change(edit, done) {
  if (draft) draft.typing = false;
  flush();
  work = work.then(() => store(edit, done));
}

// The whole of it, from the JSON view; of a sample a copy.
async function storeWhole(body) {
  if (!own) return openNew(body, " (copy)");
  await flush();
  work = work.then(() => store(() => body, "Stored."));
  const failure = await work;
  if (!failure) return;
  say("", false); // the dialog tells
  throw failure;
}

// Where the numbers of a row would put its touch; null while one of them is no number.
function placed(number, input) {
  const touch = touchOf(number),
    value = input.valueAsNumber;
  if (!Number.isFinite(value)) return null;
  return (body) => {
    const { position_m, orientation_wxyz } = contactIn(body, touch.phases[0], touch.effector);
    if (input.name === "yaw")
      return moved(
        body,
        touch,
        position_m,
        turned(orientation_wxyz, ((value - yawOf(orientation_wxyz)) * Math.PI) / 180),
      );
    return moved(body, touch, position_m.with("xyz".indexOf(input.name), value), orientation_wxyz);
  };
}

function preview(number, input) {
  const edit = placed(number, input);
  if (edit && picture.there) propose(edit, { typing: true });
}

function typed(number, input) {
  const edit = placed(number, input);
  if (!edit) return back();
  change(edit, `Contact ${number} stored.`);
}

// The mark moves with each press; what it comes to is stored once the keys rest.
function nudge(event, number) {
  const by = NUDGES[event.key];
  if (!by || !own || !picture.there || event.ctrlKey || event.metaKey || event.altKey) return;
  event.preventDefault();
  if (chosen !== number) choose(number);
  const touch = touchOf(number),
    step = event.shiftKey ? FINE_M : NUDGE_M;
  const { position_m: from, orientation_wxyz } = contactIn(now(), touch.phases[0], touch.effector);
  const position_m = [round(from[0] + step * by[0]), round(from[1] + step * by[1]), from[2]];
  later(`contact ${number}`, (body) => moved(body, touch, position_m, orientation_wxyz), `Contact ${number} stored.`);
}

// Shows what keys have changed at once, and stores it when they rest; `key` names what they change.
function later(key, edit, done) {
  if (pending && pending.key !== key) flush();
  clearTimeout(pending?.timer);
  pending = { key, edit, done, timer: setTimeout(flush, AFTER_KEYS_MS) };
  draft = { body: edit(now()) };
  show();
}

// Stores what the keys have changed; resolves when nothing is left to be stored.
function flush() {
  const ready = pending;
  if (ready && !ready.sent) {
    clearTimeout(ready.timer);
    ready.sent = true;
    work = work
      .then(() => store(ready.edit, ready.done))
      .then(() => {
        if (pending === ready) pending = null;
      });
  }
  return work;
}

// One step back, or forth again.
function step(way, nothing, done) {
  work = flush().then(async () => {
    let failure = null,
      stepped = false;
    try {
      stepped = await kept[way]();
    } catch (error) {
      failure = error;
    }
    await refresh();
    tell(failure, stepped ? done : nothing);
  });
}
const goBack = () => step("undo", "There is nothing to undo.", "Undone.");
const goForth = () => step("redo", "There is nothing to redo.", "Done again.");

undo?.addEventListener("click", goBack);
redo?.addEventListener("click", goForth);
// Where text is typed, the keys undo the typing.
const changeable = () => own;
const shortcuts = new Shortcuts([
  {
    keys: ["z"],
    ctrl: true,
    text: "Undo; with Shift, do again",
    run: (event) => (event.shiftKey ? goForth() : goBack()),
    when: changeable,
  },
  { keys: ["y"], ctrl: true, text: "Do again", run: goForth, when: changeable },
  { keys: ["ArrowLeft", "ArrowRight"], text: "On a phase: the one before or after" },
  { keys: ["ArrowLeft", "ArrowRight"], text: "On the end of a phase: 0.05 s, with Shift 0.01 s", when: changeable },
  {
    keys: ["ArrowLeft", "ArrowRight", "ArrowUp", "ArrowDown"],
    text: "On a contact of the list: 1 cm, with Shift 1 mm",
    when: changeable,
  },
  ...CAMERA_KEYS,
]);

const copyButton = part("copy");
copyButton?.addEventListener("click", async () => {
  copyButton.disabled = true;
  try {
    await openNew(bodyOf(await call("GET", `/scenarios/${id}`)), " (copy)");
  } catch (error) {
    say(error.message, true);
    copyButton.disabled = false;
  }
});

function say(text, wrong) {
  said.textContent = text;
  said.classList.toggle("wrong", wrong);
}

const round = (v) => Math.round(v * 1e4) / 1e4;
