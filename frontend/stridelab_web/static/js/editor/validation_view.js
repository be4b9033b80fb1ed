// What an editor shows of the judge's answer: the verdict, the phases, the margins of a contact, and the picture. The
// learned reach answers first; the whole body, which is asked besides, has the last word.
import { Judge } from "./validation.js";
import { Posture } from "./posture.js";
import { showMarks, showSupport } from "./support_overlay.js";
import { UNFINISHED, marginsOf, phasesOf, placeOf, sentenceOfPhase, tightest, verdictOf } from "./validation_text.js";

export class Judged {
  // `strip` shows the phases; `turn(k)` hears which of them is chosen.
  constructor(root, rows, strip, turn) {
    const part = (name) => root.querySelector(`[data-${name}]`);
    this.root = root;
    this.rows = rows;
    this.strip = strip;
    this.turn = turn;
    this.verdict = part("verdict");
    this.said = part("phase-said");
    this.answer = null;
    this.phases = [];
    this.phase = null;
    this.nodes = null;
    this.touches = [];
    this.chosen = null;
    this.learned = null;
    this.whole = null;
    this.wholeOf = null;
    this.trouble = "";
    this.body = null;
    this.posture = new Posture();
    this.judge = new Judge(
      (answer, body) => this.hear(answer, body),
      (sentence) => this.say(sentence, "invalid"),
    );
    const query = () => `?body_checked=true${this.phase === null ? "" : `&posture_of=${this.phase}`}`;
    this.bodies = new Judge(
      (answer, body) => this.hearBody(answer, body),
      (sentence) => this.noBody(sentence),
      query,
    );
  }

  // What the picture shows, and which touch is chosen (its number, or null).
  look(nodes, touches, chosen) {
    const other = chosen !== this.chosen;
    Object.assign(this, { nodes, touches, chosen });
    if (other) {
      this.phase = this.phaseOf(chosen);
      this.askPosture();
    }
    this.show();
  }

  ask(body) {
    this.body = body;
    this.posture.of(body.robot).then(() => this.drawPosture());
    this.judge.ask(body);
    this.bodies.ask(body);
  }

  hear(answer, body) {
    this.learned = answer;
    this.weigh(body);
  }

  hearBody(answer, body) {
    Object.assign(this, { whole: answer, wholeOf: body, trouble: "" });
    this.posture.take(answer.phases.find((one) => one.link_poses)?.link_poses);
    if (this.learned) this.weigh(this.body);
    this.drawPosture();
    this.root.dataset.bodied = String(Number(this.root.dataset.bodied ?? 0) + 1); // what tests wait for
    if (answer.warnings.some(({ code }) => code === UNFINISHED) && body === this.body) this.bodies.ask(body);
  }

  noBody(sentence) {
    this.whole = null;
    this.trouble = sentence;
    if (this.learned) this.weigh(this.body);
  }

  // While something is dragged, the body's last word is about the place before. A refusal stays until the next one; a
  // consent does not.
  weigh(body) {
    const fresh = this.wholeOf === this.body || this.whole?.phases.some((one) => one.body === "unreachable");
    const whole = fresh && this.whole?.phases.length === body.phases.length ? this.whole : null;
    const { errors, kind, text } = verdictOf(this.learned, whole, this.trouble);
    if (this.learned.support.length !== body.phases.length) return; // an answer to another scenario
    this.answer = { ...this.learned, errors };
    this.phases = phasesOf(this.answer, body);
    if (!(this.phase < this.phases.length)) this.phase = null;
    this.phase ??= this.phaseOf(this.chosen);
    this.say(text, kind);
    this.show();
  }

  say(text, kind) {
    this.root.dataset.judged = kind;
    if (this.verdict.textContent !== text) this.verdict.textContent = text;
  }

  choosePhase(k) {
    this.phase = k;
    this.show();
    this.askPosture();
  }

  // The posture of the phase that is looked at; the service remembers the stances that it has found.
  askPosture() {
    if (this.body) this.bodies.ask(this.body);
  }

  drawPosture() {
    if (!this.nodes?.viser) return;
    this.posture.show(this.nodes);
    this.nodes.draw();
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
    this.posture.show(this.nodes);
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
        if (there && (place.effector === null ? number === this.chosen : effector === place.effector))
          found.add(number);
      }
    }
    return found;
  }
}
