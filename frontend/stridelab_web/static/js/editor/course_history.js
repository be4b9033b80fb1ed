// Undo and redo of a course that is not stored in the service; the browser tab remembers it over a reload.

const MAX_STEPS = 100;

/** @template T */
export class CourseHistory {
  // `key` names the course in the session's storage.
  /** @param {string} key @param {T} initial */
  constructor(key, initial) {
    this.key = key;
    /** @type {{ past: T[], present: T, future: T[] }} */
    this.steps = readSaved(key) ?? { past: [], present: initial, future: [] };
  }

  get present() {
    return this.steps.present;
  }

  get canUndo() {
    return this.steps.past.length > 0;
  }

  get canRedo() {
    return this.steps.future.length > 0;
  }

  // Adds a step, unless nothing changed.
  /** @param {T} next */
  record(next) {
    const { past, present } = this.steps;
    if (JSON.stringify(next) === JSON.stringify(present)) return;
    this.steps = { past: [...past, present].slice(-MAX_STEPS), present: next, future: [] };
    this.save();
  }

  // The previous state, which becomes the present one.
  undo() {
    const { past, present, future } = this.steps;
    const before = past.at(-1);
    if (before === undefined) return present;
    this.steps = { past: past.slice(0, -1), present: before, future: [present, ...future] };
    this.save();
    return before;
  }

  redo() {
    const { past, present, future } = this.steps;
    const [after, ...later] = future;
    if (after === undefined) return present;
    this.steps = { past: [...past, present], present: after, future: later };
    this.save();
    return after;
  }

  save() {
    try {
      sessionStorage.setItem(this.key, JSON.stringify(this.steps));
    } catch {
      sessionStorage.removeItem(this.key); // storage is full: the history ends with this page
    }
  }
}

/** @param {string} key */
function readSaved(key) {
  try {
    return JSON.parse(sessionStorage.getItem(key) ?? "null");
  } catch {
    return null;
  }
}
