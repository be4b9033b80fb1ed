// The scenario in the service: reads and stores it with undo and redo, which survive a reload, and stores copies of it.
import { call, isUnanswered } from "../shared/api.js";
import { untilAnswering } from "../shared/connection_notice.js";
import { rotateAboutZ, yawDegrees } from "../viewer/quaternions.js";
import { contactOf } from "./phase_edits.js";

const FIELDS = ["name", "description", "robot", "friction", "start_com_height_m", "terrain", "phases"];
const MAX_NAME_LENGTH = 120;
export const CONTACTS_SUFFIX = ": contacts found"; // end of the name of a scenario that the contact planner made
const COPY_SUFFIX = " (copy)";
export const DURATIONS_SUFFIX = ": durations chosen"; // and of one with the durations of a plan
const MAX_STEPS = 40;
const WAITS = "Not stored yet: it will be once the service answers.";
const WAITS_FOR_LOGIN = "Not stored yet: it will be once you have logged in again.";

/** @type {(a: unknown, b: unknown) => boolean} */
export const sameJson = (a, b) => JSON.stringify(a) === JSON.stringify(b);

// The fields that a client may store, without those that the service adds.
/** @param {any} stored @returns {any} */
export const scenarioFields = (stored) => Object.fromEntries(FIELDS.map((name) => [name, stored[name]]));

// Moves a touch to another pose, in all its phases.
/** @type {(scenario: Scenario, touch: Pick<Touch, "effector" | "phases">, position_m: number[], orientation_wxyz: number[]) => Scenario} */
export function moveContact(scenario, touch, position_m, orientation_wxyz) {
  const [first, last] = touch.phases;
  const replace = (/** @type {Contact} */ contact) =>
    contact.effector === touch.effector ? { ...contact, position_m, orientation_wxyz } : contact;
  const phases = scenario.phases.map((phase, k) =>
    k < first || k > last ? phase : { ...phase, contacts: phase.contacts.map(replace) },
  );
  return { ...scenario, phases };
}

// Moves a touch to one number of its pose: `x`, `y` or `z` in metres, or `yaw` in degrees.
/** @param {Scenario} scenario @param {Touch} touch @param {string} name @param {number} value */
export function setPoseNumber(scenario, touch, name, value) {
  const { position_m, orientation_wxyz } = contactOf(scenario, touch);
  if (name !== "yaw")
    return moveContact(scenario, touch, position_m.with("xyz".indexOf(name), value), orientation_wxyz);
  const turn_rad = ((value - yawDegrees(orientation_wxyz)) * Math.PI) / 180;
  return moveContact(scenario, touch, position_m, rotateAboutZ(orientation_wxyz, turn_rad));
}

// Stores a scenario under its name with a suffix as a new one, and opens that in the editor.
/** @param {Scenario} scenario @param {string} suffix */
export async function openAsNewScenario(scenario, suffix) {
  const created = await call("POST", "/scenarios", { ...scenario, name: withSuffix(scenario.name, suffix) });
  location.assign(`/view/?scenario=${encodeURIComponent(created.id)}`);
}

/** @param {string} name @param {string} suffix */
const withSuffix = (name, suffix) =>
  name.endsWith(suffix) ? name : name.slice(0, MAX_NAME_LENGTH - suffix.length) + suffix;

export class ScenarioStore {
  // Of a read-only scenario, an edit is stored as a copy.
  /** @param {string} id @param {boolean} isReadOnly */
  constructor(id, isReadOnly = false) {
    this.id = id;
    this.isReadOnly = isReadOnly;
    /** @type {any} */
    this.scenario = null; // a Scenario, once it is read
    this.version = "";
    /** @type {Scenario[]} */
    this.past = [];
    /** @type {Scenario[]} */
    this.future = [];
  }

  // Reads the stored scenario. Returns true if it was changed elsewhere, which becomes a step that can be undone.
  async read() {
    const stored = await call("GET", `/scenarios/${this.id}`);
    const scenario = scenarioFields(stored),
      before = this.scenario;
    Object.assign(this, { scenario, version: stored.updated_at });
    if (before === null) this.restoreHistory();
    else if (!sameJson(before, scenario)) this.pushUndoStep(before);
    return before !== null && !sameJson(before, scenario);
  }

  // Where the service does not answer or the login has ended, calls `onWait(sentence)`, waits, and stores then.
  /** @param {Scenario} scenario @param {(sentence: string) => void} [onWait] @returns {Promise<void>} */
  async store(scenario, onWait = () => {}) {
    const before = this.scenario;
    if (this.isReadOnly) return this.storeCopy(scenario, before);
    try {
      await this.replaceStored(scenario);
    } catch (error) {
      if (!isUnanswered(error)) throw error;
      onWait(error.status ? WAITS_FOR_LOGIN : WAITS);
      await untilAnswering();
      if (await this.isStored(scenario)) this.scenario = scenario;
      else return this.store(scenario, onWait);
    }
    this.pushUndoStep(before);
  }

  // Whether a request whose answer was lost has been carried out.
  /** @param {Scenario} scenario */
  async isStored(scenario) {
    const stored = await call("GET", `/scenarios/${this.id}`).catch(() => null);
    if (!stored || !sameJson(scenarioFields(stored), scenarioFields(scenario))) return false;
    this.version = stored.updated_at;
    return true;
  }

  // Stores a copy with `scenario` and opens it at the same phase and contact; there, `before` can be restored by undo. The
  // promise does not resolve, because the page is left.
  /** @param {Scenario} scenario @param {Scenario} before @returns {Promise<never>} */
  async storeCopy(scenario, before) {
    const name = withSuffix(scenario.name, COPY_SUFFIX);
    const created = await call("POST", "/scenarios", { ...scenario, name });
    Object.assign(this, { id: created.id, scenario: scenarioFields(created), past: [{ ...before, name }], future: [] });
    this.saveHistory();
    const url = new URL(location.href);
    url.searchParams.set("scenario", created.id);
    location.assign(url);
    return new Promise(() => {});
  }

  undo() {
    return this.step(this.past, this.future);
  }

  redo() {
    return this.step(this.future, this.past);
  }

  // Stores the last scenario of `from` and pushes the replaced one to `to`. Returns false if `from` is empty.
  /** @param {Scenario[]} from @param {Scenario[]} to */
  async step(from, to) {
    const scenario = from.at(-1),
      current = this.scenario;
    if (!scenario) return false;
    await this.replaceStored(scenario);
    from.pop();
    to.push(current);
    this.saveHistory();
    return true;
  }

  // Does not overwrite a version that was stored elsewhere since it was read: the service then answers 412.
  /** @param {Scenario} scenario */
  async replaceStored(scenario) {
    const stored = await call("PUT", `/scenarios/${this.id}`, scenario, { "If-Match": JSON.stringify(this.version) });
    Object.assign(this, { scenario: scenarioFields(stored), version: stored.updated_at });
  }

  /** @param {Scenario} before */
  pushUndoStep(before) {
    this.past.push(before);
    if (this.past.length > MAX_STEPS) this.past.shift();
    this.future = [];
    this.saveHistory();
  }

  get storageKey() {
    return `stridelab-steps-${this.id}`;
  }

  saveHistory() {
    try {
      sessionStorage.setItem(
        this.storageKey,
        JSON.stringify({ body: this.scenario, past: this.past, future: this.future }),
      );
    } catch {
      sessionStorage.removeItem(this.storageKey); // storage is full: the history ends with this page
    }
  }

  // Restores the history of this tab after a reload, unless the scenario was changed elsewhere since.
  restoreHistory() {
    const saved = JSON.parse(sessionStorage.getItem(this.storageKey) ?? "null");
    if (saved && sameJson(saved.body, this.scenario)) Object.assign(this, { past: saved.past, future: saved.future });
  }
}
