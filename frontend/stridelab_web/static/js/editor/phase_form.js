// The chosen phase in numbers: how long it lasts, what touches in it, and buttons that split, add and remove phases.
import { added, around, endsOf, freshPlace, lasting, removed, split, touching } from "./phase_edits.js";

const DEEDS = { split: [split, "split"], added: [added, "followed by a new one"], removed: [removed, "removed"] };

export class PhaseForm {
  // `change(edit, said)` stores a change of the scenario; `propose(edit)` shows what is typed, `back()` takes that back.
  constructor(root, own, { change, propose, back }) {
    const form = root.querySelector("[data-phase-form]");
    this.form = form;
    this.own = own;
    this.change = change;
    this.k = 0;
    this.body = null;
    this.typing = false;
    this.duration = form.elements.duration;
    this.number = form.querySelector("[data-phase-number]");
    this.when = form.querySelector("[data-phase-when]");
    this.selects = [...form.querySelectorAll("select[data-effector]")];
    form.addEventListener("submit", (event) => event.preventDefault());
    for (const field of form.elements) field.disabled = !own;
    if (!own) return;
    this.duration.addEventListener("input", () => {
      this.typing = true;
      if (this.duration.validity.valid) propose((body) => lasting(body, this.k, this.duration.valueAsNumber));
    });
    this.duration.addEventListener("change", () => this.last());
    this.duration.addEventListener("blur", () => {
      this.typing = false;
      back();
    });
    for (const button of form.querySelectorAll("[data-deed]"))
      button.addEventListener("click", () => this.do(button.dataset.deed));
    for (const select of this.selects)
      select.addEventListener("change", () => this.touch(select.dataset.effector, select.value));
  }

  show(body, k) {
    Object.assign(this, { body, k: Math.min(k, body.phases.length - 1) });
    const phase = body.phases[this.k],
      end_s = endsOf(body)[this.k];
    this.number.textContent = `${this.k} (${this.k + 1} of ${body.phases.length})`;
    this.when.textContent = `from ${(end_s - phase.duration_s).toFixed(2)} s to ${end_s.toFixed(2)} s`;
    const text = String(phase.duration_s);
    if (!this.typing && this.duration.value !== text) this.duration.value = text;
    for (const select of this.selects) this.offer(select);
  }

  // What an effector can do in the phase: stay away, be where it was or will be, or be somewhere else.
  offer(select) {
    const { here, before, after, chosen } = around(this.body, this.k, select.dataset.effector);
    const wanted = [["away", "does not touch"]];
    if (before) wanted.push(["before", `as in phase ${before.phase}`]);
    if (after) wanted.push(["after", `as in phase ${after.phase}`]);
    if (!here || chosen === "own") wanted.push(["own", here ? "at a place of its own" : "at a new place"]);
    const now = [...select.options].map((option) => [option.value, option.text]);
    if (JSON.stringify(now) !== JSON.stringify(wanted))
      select.replaceChildren(...wanted.map(([value, text]) => new Option(text, value)));
    select.value = chosen;
  }

  last() {
    this.typing = false;
    const duration_s = this.duration.valueAsNumber,
      k = this.k;
    if (Number.isFinite(duration_s)) this.change((body) => lasting(body, k, duration_s), `Phase ${k} stored.`);
    else this.show(this.body, k);
  }

  do(name) {
    const [deed, said] = DEEDS[name],
      k = this.k;
    this.change((body) => deed(body, k), `Phase ${k} ${said}.`);
  }

  touch(effector, what) {
    const k = this.k;
    this.change((body) => touching(body, k, effector, this.wanted(body, k, effector, what)), `Phase ${k} stored.`);
  }

  // Adds an effector to phase k where it was or will be, or takes it away.
  toggle(k, effector) {
    const { here, before, after } = around(this.body, k, effector);
    const what = here ? "away" : before ? "before" : after ? "after" : "own";
    this.change((body) => touching(body, k, effector, this.wanted(body, k, effector, what)), `Phase ${k} stored.`);
  }

  wanted(body, k, effector, what) {
    if (what === "away") return null;
    const { here, [what]: near } = around(body, k, effector);
    return what === "own" ? (here ?? freshPlace(body, k, effector)) : near.contact;
  }
}
