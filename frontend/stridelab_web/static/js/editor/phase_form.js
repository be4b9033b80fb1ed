// The form of the chosen phase: duration, contact of each effector, and buttons that split, add and remove phases.
import {
  duplicatePhase,
  contactChoices,
  phaseEndTimes,
  suggestContact,
  setDuration,
  removePhase,
  splitPhase,
  setContact,
} from "./phase_edits.js";

/** @type {Record<string, [(scenario: Scenario, k: number) => Scenario, string]>} */
const ACTIONS = {
  split: [splitPhase, "split"],
  added: [duplicatePhase, "followed by a new one"],
  removed: [removePhase, "removed"],
};

export class PhaseForm {
  // `onCommit(edit, message)` stores an edit, `onInput(edit)` shows one while it is typed, `onLeave()` discards that.
  /**
   * @param {PageElement} root
   * @param {{ onCommit: (edit: ScenarioEdit, done: string) => void, onInput: (edit: ScenarioEdit) => void, onLeave: () => void }} options
   */
  constructor(root, { onCommit, onInput, onLeave }) {
    const form = root.querySelector("[data-phase-form]");
    this.form = form;
    this.onCommit = onCommit;
    this.k = 0;
    /** @type {any} */
    this.scenario = null;
    this.isTyping = false;
    this.duration = form.elements.duration;
    this.number = form.querySelector("[data-phase-number]");
    this.when = form.querySelector("[data-phase-when]");
    this.selects = [...form.querySelectorAll("select[data-effector]")];
    form.addEventListener("submit", (event) => event.preventDefault());
    this.duration.addEventListener("input", () => {
      this.isTyping = true;
      if (this.duration.validity.valid)
        onInput((scenario) => setDuration(scenario, this.k, this.duration.valueAsNumber));
    });
    this.duration.addEventListener("change", () => this.commitDuration());
    this.duration.addEventListener("blur", () => {
      this.isTyping = false;
      onLeave();
    });
    for (const button of form.querySelectorAll("[data-deed]"))
      button.addEventListener("click", () => this.runAction(button.dataset.deed));
    for (const select of this.selects)
      select.addEventListener("change", () => this.setEffector(select.dataset.effector, select.value));
  }

  /** @param {Scenario} scenario @param {number} k */
  show(scenario, k) {
    Object.assign(this, { scenario, k: Math.min(k, scenario.phases.length - 1) });
    const phase = scenario.phases[this.k],
      end_s = phaseEndTimes(scenario)[this.k];
    this.number.textContent = `${this.k} (${this.k + 1} of ${scenario.phases.length})`;
    this.when.textContent = `from ${(end_s - phase.duration_s).toFixed(2)} s to ${end_s.toFixed(2)} s`;
    const text = String(phase.duration_s);
    if (!this.isTyping && this.duration.value !== text) this.duration.value = text;
    for (const select of this.selects) this.fillOptions(select);
  }

  // The choices of an effector: no contact, the contact of an earlier or a later phase, or a contact of its own.
  /** @param {PageElement} select */
  fillOptions(select) {
    const { here, before, after, chosen } = contactChoices(this.scenario, this.k, select.dataset.effector);
    const options = [["away", "does not touch"]];
    if (before) options.push(["before", `as in phase ${before.phase}`]);
    if (after) options.push(["after", `as in phase ${after.phase}`]);
    if (!here || chosen === "own") options.push(["own", here ? "at a place of its own" : "at a new place"]);
    const current = [...select.options].map((option) => [option.value, option.text]);
    if (JSON.stringify(current) !== JSON.stringify(options))
      select.replaceChildren(...options.map(([value, text]) => new Option(text, value)));
    select.value = chosen;
  }

  commitDuration() {
    this.isTyping = false;
    const duration_s = this.duration.valueAsNumber,
      k = this.k;
    if (Number.isFinite(duration_s))
      this.onCommit((scenario) => setDuration(scenario, k, duration_s), `Phase ${k} stored.`);
    else this.show(this.scenario, k);
  }

  /** @param {string} name */
  runAction(name) {
    const [edit, outcome] = ACTIONS[name],
      k = this.k;
    this.onCommit((scenario) => edit(scenario, k), `Phase ${k} ${outcome}.`);
  }

  /** @param {string} effector @param {string} choice */
  setEffector(effector, choice, k = this.k) {
    this.onCommit(
      (scenario) => setContact(scenario, k, effector, this.contactFor(scenario, k, effector, choice)),
      `Phase ${k} stored.`,
    );
  }

  // Removes the contact of an effector in phase k, or adds the one of the nearest earlier or later phase.
  /** @param {number} k @param {string} effector */
  toggle(k, effector) {
    const { here, before, after } = contactChoices(this.scenario, k, effector);
    const choice = here ? "away" : before ? "before" : after ? "after" : "own";
    this.setEffector(effector, choice, k);
  }

  /** @param {Scenario} scenario @param {number} k @param {string} effector @param {string} choice */
  contactFor(scenario, k, effector, choice) {
    if (choice === "away") return null;
    const choices = contactChoices(scenario, k, effector);
    const { here } = choices,
      nearest = choices[/** @type {"before" | "after"} */ (choice)];
    return choice === "own" ? (here ?? suggestContact(scenario, k, effector)) : (nearest?.contact ?? null);
  }
}
