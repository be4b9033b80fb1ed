// What an editor shows of the judge's answer: the verdict, the phases, the margins of a contact, and the picture.
import { Judge } from "./judge.js";
import { showMarks, showSupport } from "./support_view.js";
import { marginsOf, phasesOf, placeOf, sentenceOf, sentenceOfPhase, tightest } from "./verdict.js";

const VALID = "Valid: every contact is on its surface and within reach.";

export class Judged {
  // `strip` shows the phases; `turn(k)` hears which of them is chosen.
  constructor(root, rows, strip, turn) {
    const part = (name) => root.querySelector(`[data-${name}]`);
    Object.assign(this, { root, rows, strip, turn, verdict: part("verdict"), said: part("phase-said"), answer: null, phases: [], phase: null });
    Object.assign(this, { nodes: null, touches: [], chosen: null });
    this.judge = new Judge((answer, body) => this.hear(answer, body), (sentence) => this.say(sentence, false));
  }

  // What the picture shows, and which touch is chosen (its number, or null).
  look(nodes, touches, chosen) {
    const other = chosen !== this.chosen;
    Object.assign(this, { nodes, touches, chosen });
    if (other) this.phase = this.phaseOf(chosen);
    this.show();
  }

  ask(body) {
    this.judge.ask(body);
  }

  hear(answer, body) {
    this.answer = answer;
    this.phases = phasesOf(answer, body);
    if (!(this.phase < this.phases.length)) this.phase = null;
    this.phase ??= this.phaseOf(this.chosen);
    const remark = answer.warnings[0]?.message ?? "";
    this.say(answer.errors.length ? sentenceOf(answer.errors[0]) : `${VALID} ${remark}`.trim(), answer.valid);
    this.show();
  }

  say(text, valid) {
    this.root.dataset.judged = valid ? "valid" : "invalid";
    if (this.verdict.textContent !== text) this.verdict.textContent = text;
  }

  choosePhase(k) {
    this.phase = k;
    this.show();
  }

  // The worst phase of a touch; of all, where none is chosen.
  phaseOf(number) {
    const touch = this.touches.find((one) => one.number === number);
    const [first, last] = touch ? touch.phases : [0, this.phases.length - 1];
    const numbers = Array.from({ length: last - first + 1 }, (_, i) => first + i).filter((k) => k < this.phases.length);
    return numbers.length ? tightest(this.phases, numbers) : null;
  }

  show() {
    const phase = this.phases[this.phase];
    if (!phase) return;
    this.strip.judge(this.phases, this.phase);
    this.turn(this.phase);
    const said = sentenceOfPhase(phase, this.phase);
    if (this.said.textContent !== said) this.said.textContent = said;
    const touch = this.touches.find((one) => one.number === this.chosen);
    if (touch) this.rows.margins(touch.number, marginsOf(this.answer, touch));
    if (!this.nodes?.viser) return;
    showSupport(this.nodes, phase);
    showMarks(this.nodes, this.touches, this.phase, this.chosen, this.wrong());
    this.nodes.draw();
  }

  // Numbers of the touches that errors name; where an error names a phase alone, the chosen touch if it is there.
  wrong() {
    const found = new Set();
    for (const place of this.answer.errors.map(placeOf)) {
      if (!place) continue;
      for (const { number, effector, phases } of this.touches) {
        const there = phases[0] <= place.phase && place.phase <= phases[1];
        if (there && (place.effector === null ? number === this.chosen : effector === place.effector)) found.add(number);
      }
    }
    return found;
  }
}
