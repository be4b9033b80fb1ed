// The scenario editor: 3D scene, phase timeline, phase form and contact list. Changes by dragging, typing or keys are
// stored in the service through one queue and can be undone. What the first view does not need is loaded on first use.
import { ValidationView } from "./validation_view.js";
import { LivePreview } from "./live_preview.js";
import { PhaseForm } from "./phase_form.js";
import { SceneView } from "./scene_view.js";
import { bindContactsButton, bindPlanButton } from "./planning_jobs.js";
import { ContactList } from "./contact_list.js";
import { ScenarioStore, moveContact, sameJson, setPoseNumber } from "./scenario_store.js";
import { contactOf } from "./phase_edits.js";
import { writeToAddress } from "../shared/elements.js";
import { setActive } from "../shared/focus.js";
import { CAMERA_KEYS, Shortcuts } from "../shared/shortcuts.js";
import { PhaseTimeline } from "./phase_timeline.js";
import { showFailure, hideOverlay } from "../viewer/loading_overlay.js";

const [POLL_MS, STORE_DELAY_MS] = [100, 500];
const [STEP_M, FINE_STEP_M] = [0.01, 0.001];
const PRECONDITION_FAILED = 412;
const CHANGED_ELSEWHERE = "Changed in another window; its current state is shown. Undo reverts that change, too.";
const CONFLICT = "Not stored: it was changed in another window in the meantime. Its current state is shown.";
// Directions (x, y) of the arrow keys, seen from behind the robot: x points forward, y to its left.
/** @type {Record<string, number[]>} */
const DIRECTIONS = { ArrowUp: [1, 0], ArrowDown: [-1, 0], ArrowLeft: [0, 1], ArrowRight: [0, -1] };

const root = document.querySelector("[data-editor]");
const part = (/** @type {string} */ name) => root.querySelector(`[data-${name}]`);
const [status, undo, redo] = ["said", "undo", "redo"].map(part);
const id = root.dataset.scenario,
  isReadOnly = root.dataset.own !== "true"; // the first edit is stored as a copy, which is opened
const store = new ScenarioStore(id, isReadOnly);
const sceneView = new SceneView(part("stage"));
const contactList = new ContactList(root, {
  onChoose: toggleContact,
  onKey: onContactKey,
  onInput: previewInput,
  onCommit: commitInput,
  onLeave: discardTyping,
});
const form = new PhaseForm(root, {
  onCommit: commitEdit,
  onInput: (edit) => propose(edit, { isTyping: true }),
  onLeave: discardTyping,
});
/** @type {import("./terrain_list.js").TerrainList | undefined} */
let terrainList;
const terrain = root.querySelector("details.terrain");
terrain.addEventListener("toggle", () => run(showTerrain()), { once: true });
const timeline = new PhaseTimeline(root, {
  onChoosePhase: choosePhase,
  onChooseContact: chooseContact,
  onToggle: (k, effector) => form.toggle(k, effector),
  onPropose: propose,
  onCommit: commitEdit,
  onKeyEdit: storeLater,
  onDiscard: discardDraft,
});
const validation = new ValidationView(root, contactList, timeline, (k) => form.show(currentScenario(), k));
const preview = new LivePreview(root);

// `draft` is shown and not stored yet; `pending`, made by keys, is stored after a pause; `queue` resolves after all requests.
let /** @type {Touch[]} */ touches = [],
  /** @type {number | null} */ chosenContact = null,
  /** @type {{ scenario: any, draggedContact?: number, isTyping?: boolean } | null} */ draft = null,
  /** @type {{ key: string, edit: ScenarioEdit, done: string, timer: number, sent?: boolean } | null} */ pending = null,
  /** @type {Promise<any>} */ queue = Promise.resolve();
const currentScenario = () => draft?.scenario ?? store.scenario;
const touchOf = (/** @type {number | null} */ number) => touches.find((touch) => touch.number === number);
// The touch of a row of the list, which shows only touches that there are.
const placedTouch = (/** @type {number} */ number) => /** @type {Touch} */ (touchOf(number));

start().catch((error) => showFailure(part("stage"), error));
/** @type {import("./plan_playback.js").PlanPlayback | undefined} */
let playback;
const followPlan = bindPlanButton(root, id, {
  before: flushPending,
  onRun: () => withPlayback((loaded) => loaded.start(store.scenario)),
  onJob: (jobId) => withPlayback((loaded) => loaded.follow(jobId)),
  onProgress: () => withPlayback((loaded) => loaded.onEvent()),
  onSuccess: async () => playback?.showLastParts(),
  onEnd: () => withPlayback((loaded) => loaded.stop()),
});
bindContactsButton(root, id, flushPending);
/** @type {import("./json_view.js").JsonView | undefined} */
let jsonView;
part("json-open").addEventListener("click", () => run(openJson()));

async function start() {
  await store.read();
  touches = await sceneView.readTouches();
  contactList.rebuild(touches);
  timeline.draw(store.scenario, touches);
  await sceneView.synchronise();
  await sceneView.start(touches, store.scenario, shortcuts);
  const wanted = new URLSearchParams(location.search),
    [number, phase] = ["contact", "phase"].map((name) => (wanted.has(name) ? Number(wanted.get(name)) : null));
  if (touchOf(number)) chooseContact(number, false);
  if (phase !== null && phase in store.scenario.phases) validation.choosePhase(phase);
  render();
  preview.start(sceneView.nodes);
  await hideOverlay(part("stage"), sceneView.nodes);
  root.dataset.ready = "true";
  setInterval(pollScene, POLL_MS);
  followPlan();
}

// Shows why a part of the page could not be loaded or used.
/** @param {Promise<unknown>} promise */
function run(promise) {
  promise.catch((error) => setStatus(/** @type {Error} */ (error).message, true));
}

async function showTerrain() {
  const { TerrainList } = await import("./terrain_list.js");
  terrainList = new TerrainList(root, { onCommit: commitEdit });
  if (store.scenario) terrainList.show(currentScenario());
}

async function openJson() {
  const { JsonView } = await import("./json_view.js");
  jsonView ??= new JsonView(root, { read: () => currentScenario() ?? {}, store: storeScenario });
  jsonView.open();
}

// Calls `use` with the playback of the plan, in the order of the calls.
/** @param {(playback: import("./plan_playback.js").PlanPlayback) => unknown} use */
function withPlayback(use) {
  run(
    import("./plan_playback.js").then(({ playbackInEditor }) => {
      playback ??= playbackInEditor(root, preview, sceneView, validation, (text) => setStatus(text, false));
      use(playback);
    }),
  );
}

/** @param {number} number */
function toggleContact(number) {
  chooseContact(chosenContact === number ? null : number);
}

/** @param {number | null} number */
function chooseContact(number, inUrl = true) {
  chosenContact = number;
  contactList.expandRow(number);
  if (inUrl) writeToAddress("contact", number);
  validation.setScene(sceneView.nodes, touches, chosenContact);
}

/** @param {number} k */
function choosePhase(k) {
  if (validation.instant) playback?.stop();
  validation.choosePhase(k);
  writeToAddress("phase", k);
}

// Shows the stored scenario or the draft, and requests its validation and its preview.
function render() {
  const scenario = currentScenario(),
    { nodes } = sceneView;
  for (const touch of touches) {
    const contact = contactOf(scenario, touch);
    contactList.updateRow(touch, scenario);
    if (sceneView.isReady && draft?.draggedContact !== touch.number)
      nodes.setPose(touch.node, [...contact.position_m], [...contact.orientation_wxyz]);
  }
  timeline.draw(scenario, touches);
  form.show(scenario, validation.phase ?? 0);
  part("scenario-name").textContent = scenario.name;
  terrainList?.show(scenario);
  validation.setScene(nodes, touches, chosenContact);
  if (sceneView.isReady) nodes.draw();
  validation.validate(scenario);
  preview.update(scenario);
  setActive(undo, store.past.length > 0);
  setActive(redo, store.future.length > 0);
}

// Shows the stored scenario with `edit` applied, without storing it.
/** @param {ScenarioEdit} edit */
function propose(edit, options = {}) {
  if (validation.instant) playback?.stop();
  draft = { scenario: edit(store.scenario), ...options };
  render();
}

// Shows the stored scenario again, unless an edit is waiting to be stored.
function discardDraft() {
  if (!draft || pending) return;
  draft = null;
  render();
}

// Discards a number that was typed and not confirmed.
function discardTyping() {
  if (draft?.isTyping) discardDraft();
}

// The viewer moves the mark of a contact while it is dragged; the page follows, and reads the scenario again on release.
function pollScene() {
  const change = sceneView.takeChange();
  if (change) {
    queue = queue.then(() => onSceneChange(change));
    return;
  }
  if (sceneView.nodes.isStale()) return render();
  if (pending || draft?.isTyping || timeline.drag) return;
  const dragged = isReadOnly
    ? sceneView.heldContact(touches, store.scenario)
    : sceneView.draggedContact(touches, currentScenario());
  if (!dragged) return;
  const { touch, position_m, isReleased } = dragged;
  if (chosenContact !== touch.number) chooseContact(touch.number);
  const move = (/** @type {Scenario} */ scenario) =>
    moveContact(scenario, touch, position_m, contactOf(scenario, touch).orientation_wxyz);
  if (isReleased) return commitEdit(move, "Stored.");
  propose(move, isReadOnly ? {} : { draggedContact: touch.number });
}

/** @param {{ isOwnChange: boolean }} options */
async function onSceneChange({ isOwnChange }) {
  const changed = await store.read().catch(() => false);
  if (!isOwnChange && !changed) return; // stored by this page
  const refusal = await refresh();
  if (isOwnChange) setStatus(refusal || "Stored.", Boolean(refusal));
  else setStatus(CHANGED_ELSEWHERE, true);
}

// Reads the stored scenario and updates list and scene; a pending edit made by keys stays applied. Returns the reason why
// the service refused a drag, or an empty string.
async function refresh() {
  try {
    await store.read();
    const refusal = await sceneView.synchronise();
    touches = await sceneView.readTouches();
    if (!contactList.matches(touches)) {
      const effector = touchOf(chosenContact)?.effector;
      contactList.rebuild(touches);
      chosenContact = effector && touchOf(chosenContact)?.effector === effector ? chosenContact : null;
      if (chosenContact !== null) contactList.expandRow(chosenContact);
    }
    await sceneView.update(touches, store.scenario);
    draft = pending && !pending.sent ? { scenario: pending.edit(store.scenario) } : null;
    render();
    return refusal;
  } catch (error) {
    render();
    return /** @type {Error} */ (error).message;
  }
}

// Applies `edit` to the stored scenario and stores the result; a refused edit is reverted. Returns the error, or null.
/** @param {ScenarioEdit} edit @param {string} done */
async function storeEdit(edit, done) {
  let failure = null;
  try {
    const scenario = edit(store.scenario);
    if (!sameJson(scenario, store.scenario)) {
      if (isReadOnly) setStatus("Making a copy…", false);
      await store.store(scenario, (sentence) => setStatus(sentence, true));
    }
  } catch (error) {
    failure = error;
  }
  await refresh();
  reportResult(failure, done);
  return failure;
}

/** @param {any} failure @param {string} done */
function reportResult(failure, done) {
  setStatus(failure ? (failure.status === PRECONDITION_FAILED ? CONFLICT : failure.message) : done, Boolean(failure));
}

/** @param {ScenarioEdit} edit @param {string} done */
function commitEdit(edit, done) {
  if (draft) draft.isTyping = false;
  flushPending();
  queue = queue.then(() => storeEdit(edit, done));
}

// Stores a whole scenario from the JSON dialog; a sample is stored as a copy.
/** @param {Scenario} scenario */
async function storeScenario(scenario) {
  await flushPending();
  queue = queue.then(() => storeEdit(() => scenario, "Stored."));
  const failure = await queue;
  if (failure) setStatus("", false); // the dialog shows the error
  if (failure) throw failure;
}

// The edit that moves a contact to the numbers of its row; null while the input is not a number.
/** @param {number} number @param {PageElement} input */
function editFromInput(number, input) {
  const touch = placedTouch(number),
    value = input.valueAsNumber;
  if (!Number.isFinite(value)) return null;
  return (/** @type {Scenario} */ scenario) => setPoseNumber(scenario, touch, input.name, value);
}

/** @param {number} number @param {PageElement} input */
function previewInput(number, input) {
  const edit = editFromInput(number, input);
  if (edit && sceneView.isReady) propose(edit, { isTyping: true });
}

/** @param {number} number @param {PageElement} input */
function commitInput(number, input) {
  const edit = editFromInput(number, input);
  if (!edit) return discardDraft();
  commitEdit(edit, `Contact ${number} stored.`);
}

// Each press moves the mark; the new position is stored after a pause.
/** @param {KeyboardEvent} event @param {number} number */
function onContactKey(event, number) {
  const direction = DIRECTIONS[event.key];
  if (!direction || !sceneView.isReady || event.ctrlKey || event.metaKey || event.altKey) return;
  event.preventDefault();
  if (chosenContact !== number) chooseContact(number);
  const touch = placedTouch(number),
    step_m = event.shiftKey ? FINE_STEP_M : STEP_M;
  const { position_m: from, orientation_wxyz } = contactOf(currentScenario(), touch);
  const position_m = [round(from[0] + step_m * direction[0]), round(from[1] + step_m * direction[1]), from[2]];
  storeLater(
    `contact ${number}`,
    (scenario) => moveContact(scenario, touch, position_m, orientation_wxyz),
    `Contact ${number} stored.`,
  );
}

// Shows an edit made by keys at once and stores it after a pause; edits with the same `key` are stored together.
/** @param {string} key @param {ScenarioEdit} edit @param {string} done */
function storeLater(key, edit, done) {
  if (pending && pending.key !== key) flushPending();
  clearTimeout(pending?.timer);
  pending = { key, edit, done, timer: setTimeout(flushPending, STORE_DELAY_MS) };
  draft = { scenario: edit(currentScenario()) };
  render();
}

// Stores the pending edit at once; resolves when everything is stored.
function flushPending() {
  const sending = pending;
  if (sending && !sending.sent) {
    clearTimeout(sending.timer);
    sending.sent = true;
    queue = queue
      .then(() => storeEdit(sending.edit, sending.done))
      .then(() => {
        if (pending === sending) pending = null;
      });
  }
  return queue;
}

// Undoes or redoes one step.
/** @param {"undo" | "redo"} direction @param {string} nothing @param {string} done */
function stepHistory(direction, nothing, done) {
  queue = flushPending().then(async () => {
    let failure = null,
      stepped = false;
    try {
      stepped = await store[direction]();
    } catch (error) {
      failure = error;
    }
    await refresh();
    reportResult(failure, stepped ? done : nothing);
  });
}
const undoStep = () => stepHistory("undo", "There is nothing to undo.", "Undone.");
const redoStep = () => stepHistory("redo", "There is nothing to redo.", "Redone.");

undo.addEventListener("click", undoStep);
redo.addEventListener("click", redoStep);
// In a text field, Ctrl+Z undoes the typing instead.
const shortcuts = new Shortcuts([
  {
    keys: ["z"],
    ctrl: true,
    text: "Undo; with Shift, redo",
    run: (event) => (event.shiftKey ? redoStep() : undoStep()),
  },
  { keys: ["y"], ctrl: true, text: "Redo", run: redoStep },
  { keys: ["ArrowLeft", "ArrowRight"], text: "On a phase: the previous or next one" },
  { keys: ["ArrowLeft", "ArrowRight"], text: "On the end of a phase: 0.05 s, with Shift 0.01 s" },
  {
    keys: ["ArrowLeft", "ArrowRight", "ArrowUp", "ArrowDown"],
    text: "On a contact of the list: 1 cm, with Shift 1 mm",
  },
  ...CAMERA_KEYS,
]);

/** @param {string} text @param {boolean} wrong */
function setStatus(text, wrong) {
  status.textContent = text;
  status.classList.toggle("wrong", wrong);
}

const round = (/** @type {number} */ v) => Math.round(v * 1e4) / 1e4;
