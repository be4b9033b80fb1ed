// Shows the validation of the edited scenario: summary, phases, margins of a contact, support region and robot posture. The
// result by learned reachability arrives first; the result by whole-body postures overrules it.
import { call, isUnanswered } from "../shared/api.js";
import { untilAnswering } from "../shared/connection_notice.js";
import { RobotPosture } from "./posture.js";
import { drawContactMarks, drawSupport } from "./support_overlay.js";
import {
  BODY_UNFINISHED,
  contactMargins,
  phaseStates,
  errorLocation,
  phaseSentence,
  worstPhase,
  summarizeValidation,
} from "./validation_text.js";

const MIN_INTERVAL_MS = 120;
const BODY_S = 0.03; // the chosen phase is checked first; others, and long searches, follow in further requests
// Requests the validation of a scenario while it is edited: one request at a time; of those that wait, only the latest.
class ValidationQueue {
  // Calls `onResult(check, scenario)` with each result, or `onFailure(sentence)`. `query()` is the query of the address:
  // with `body_checked`, whole-body postures are computed, which takes longer.
  /**
   * @param {(check: ScenarioCheck, scenario: Scenario) => void} onResult
   * @param {(sentence: string) => void} onFailure
   */
  constructor(onResult, onFailure, query = () => "") {
    this.onResult = onResult;
    this.onFailure = onFailure;
    this.query = query;
    this.queued = null;
    this.isBusy = false;
  }

  /** @param {Scenario} scenario */
  request(scenario) {
    this.queued = scenario;
    if (!this.isBusy) this.run();
  }

  async run() {
    this.isBusy = true;
    while (this.queued) {
      const scenario = this.queued;
      this.queued = null;
      const pause = new Promise((done) => setTimeout(done, MIN_INTERVAL_MS));
      const result = await call("POST", `/scenarios/check${this.query()}`, scenario).catch((error) => error);
      if (isUnanswered(result)) {
        await untilAnswering();
        this.queued ??= scenario;
      } else if (result instanceof Error) this.onFailure(result.message);
      else this.onResult(result, scenario);
      await pause;
    }
    this.isBusy = false;
  }
}

export class ValidationView {
  // `onPhase(k)` is called with the chosen phase.
  /**
   * @param {PageElement} root
   * @param {import("./contact_list.js").ContactList} contactList
   * @param {import("./phase_timeline.js").PhaseTimeline} timeline
   * @param {(k: number) => void} onPhase
   */
  constructor(root, contactList, timeline, onPhase) {
    const part = (/** @type {string} */ name) => root.querySelector(`[data-${name}]`);
    this.root = root;
    this.contactList = contactList;
    this.timeline = timeline;
    this.onPhase = onPhase;
    this.verdict = part("verdict");
    this.phaseText = part("phase-said");
    /** @type {any} */
    this.result = null;
    /** @type {PhaseState[]} */
    this.phases = [];
    /** @type {number | null} */
    this.phase = null;
    /** @type {PlanInstant | null} */
    this.instant = null; // of a playback, which shows its CoM and its poses in place of those of the phase
    /** @type {any} */
    this.nodes = null;
    /** @type {Touch[]} */
    this.touches = [];
    /** @type {number | null} */
    this.chosen = null;
    /** @type {ScenarioCheck | null} */
    this.reach = null;
    /** @type {any} */
    this.wholeBody = null;
    /** @type {Scenario | null} */
    this.wholeBodyScenario = null;
    this.bodyFailure = "";
    /** @type {any} */
    this.scenario = null; // a Scenario, once one is validated
    this.posture = new RobotPosture();
    this.reachQueue = new ValidationQueue(
      (result, scenario) => this.onReachResult(result, scenario),
      (sentence) => this.showVerdict(sentence, "invalid"),
    );
    const query = () =>
      `?body_checked=true&within_s=${BODY_S}${this.phase === null ? "" : `&posture_of=${this.phase}`}`;
    this.bodyQueue = new ValidationQueue(
      (result, scenario) => this.onBodyResult(result, scenario),
      (sentence) => this.onBodyFailure(sentence),
      query,
    );
  }

  // The nodes and touches of the scene, and the number of the chosen touch, or null.
  /**
   * @param {import("../viewer/viser_nodes.js").ViserNodes} nodes
   * @param {Touch[]} touches
   * @param {number | null} chosen
   */
  setScene(nodes, touches, chosen) {
    const changed = chosen !== this.chosen;
    Object.assign(this, { nodes, touches, chosen });
    if (changed) {
      this.phase = this.worstPhaseOf(chosen);
      this.requestPosture();
    }
    this.show();
  }

  /** @param {Scenario} scenario */
  validate(scenario) {
    this.scenario = scenario;
    this.posture.loadLinks(scenario.robot).then(() => this.drawPosture());
    this.reachQueue.request(scenario);
    this.bodyQueue.request(scenario);
  }

  /** @param {any} result @param {Scenario} scenario */
  onReachResult(result, scenario) {
    this.reach = result;
    this.update(scenario);
  }

  /** @param {any} result @param {Scenario} scenario */
  onBodyResult(result, scenario) {
    Object.assign(this, { wholeBody: result, wholeBodyScenario: scenario, bodyFailure: "" });
    if (!this.instant?.poses)
      this.posture.setPoses(result.phases.find((/** @type {any} */ one) => one.link_poses)?.link_poses);
    if (this.reach) this.update(this.scenario);
    this.drawPosture();
    this.root.dataset.bodied = String(Number(this.root.dataset.bodied ?? 0) + 1); // what tests wait for
    if (
      result.warnings.some((/** @type {Api.Remark} */ { code }) => code === BODY_UNFINISHED) &&
      scenario === this.scenario
    )
      this.bodyQueue.request(scenario);
  }

  /** @param {string} sentence */
  onBodyFailure(sentence) {
    this.wholeBody = null;
    this.bodyFailure = sentence;
    if (this.reach) this.update(this.scenario);
  }

  // During a drag the whole-body result is about an earlier position: an invalid one is shown until the next result, a valid
  // one is not.
  /** @param {Scenario} scenario */
  update(scenario) {
    const { reach } = this;
    if (!reach) return;
    const isCurrent =
      this.wholeBodyScenario === this.scenario ||
      this.wholeBody?.phases.some((/** @type {any} */ one) => one.body === "unreachable");
    const whole = isCurrent && this.wholeBody?.phases.length === scenario.phases.length ? this.wholeBody : null;
    const { errors, kind, text } = summarizeValidation(reach, whole, this.bodyFailure);
    if (reach.support.length !== scenario.phases.length) return; // a result for another scenario
    this.result = { ...reach, errors };
    this.phases = phaseStates(this.result, scenario);
    if (!((this.phase ?? NaN) < this.phases.length)) this.phase = null;
    this.phase ??= this.worstPhaseOf(this.chosen);
    this.showVerdict(text, kind);
    this.show();
  }

  /** @param {string} text @param {string} kind */
  showVerdict(text, kind) {
    this.root.dataset.judged = kind;
    if (this.verdict.textContent !== text) this.verdict.textContent = text;
  }

  /** @param {number} k */
  choosePhase(k) {
    this.phase = k;
    this.show();
    this.requestPosture();
  }

  // Shows an instant of a motion ({ phase, com_m, poses, ghost }; PlanPlayback); without poses, the posture of the phase. Null
  // ends it.
  /** @param {PlanInstant | null} instant */
  showInstant(instant) {
    const wasMoving = Boolean(this.instant?.poses),
      isNew = instant !== null && instant.phase !== this.phase;
    this.instant = instant;
    if (this.nodes?.viser) this.posture.showGhost(this.nodes, instant?.ghost ?? null);
    if (instant?.poses) {
      this.phase = instant.phase;
      this.posture.setPoses(instant.poses);
      this.show();
    } else if (isNew) this.choosePhase(instant.phase);
    else {
      this.show();
      if (wasMoving) this.requestPosture();
    }
  }

  // Requests the posture of the chosen phase; the service caches solved stances.
  requestPosture() {
    if (this.scenario) this.bodyQueue.request(this.scenario);
  }

  drawPosture() {
    if (!this.nodes?.viser) return;
    this.posture.show(this.nodes);
    this.nodes.draw();
  }

  // The phase of a touch with the smallest margin; of all phases without a touch.
  /** @param {number | null} number */
  worstPhaseOf(number) {
    const touch = this.touches.find((one) => one.number === number);
    const [first, last] = touch ? touch.phases : [0, this.phases.length - 1];
    const numbers = Array.from({ length: last - first + 1 }, (_, i) => first + i).filter((k) => k < this.phases.length);
    return numbers.length ? worstPhase(this.phases, numbers) : null;
  }

  show() {
    const k = this.phase ?? -1,
      phase = this.phases[k];
    if (!phase) return;
    this.timeline.showValidation(this.phases, k);
    this.onPhase(k);
    const sentence = phaseSentence(phase, k);
    if (this.phaseText.textContent !== sentence) this.phaseText.textContent = sentence;
    const touch = this.touches.find((one) => one.number === this.chosen);
    if (touch) this.contactList.showMargins(touch.number, contactMargins(this.result, touch));
    if (!this.nodes?.viser) return;
    this.posture.show(this.nodes);
    const com_m = this.instant?.com_m;
    drawSupport(this.nodes, com_m ? { ...phase, com_m } : phase);
    drawContactMarks(this.nodes, this.touches, k, this.chosen, this.invalidTouches());
    this.nodes.draw();
  }

  // Numbers of the touches that errors name; an error that names only a phase counts for the chosen touch.
  invalidTouches() {
    const numbers = new Set();
    for (const location of this.result.errors.map(errorLocation)) {
      if (!location) continue;
      for (const { number, effector, phases } of this.touches) {
        const isActive = phases[0] <= location.phase && location.phase <= phases[1];
        if (isActive && (location.effector === null ? number === this.chosen : effector === location.effector))
          numbers.add(number);
      }
    }
    return numbers;
  }
}
