// While a plan is computed: first its centre of mass moves along its path, which is solved in milliseconds, and the body takes
// the posture of each phase; then the body moves as far as it is solved; then its replay in physics runs beside it as a ghost.
import { call } from "../shared/api.js";
import { comAt } from "./live_preview.js";
import { PartialPlan, PartialReader, posesAt } from "./partial_plan.js";
import { phaseEndTimes } from "./phase_edits.js";

// Of the time until a picture is drawn, where that is slow. Without a graphics card it is a quarter of a second, and the
// browser then composes the page: a second of the processor in all, which the plan on the same machine does not get.
const SHARE = 1 / 12,
  LONGEST_PAUSE_MS = 3000;
const QUICK_MS = 50; // two pictures that are drawn within this time are followed by the next one at once
const PAUSE_MS = 1000; // at the end of the motion, before it is played again
const LAST_PARTS_MS = 10_000; // how long the page of the plan waits for the end of the certificate

// The playback of the editor's plan in its scene; the page says what is shown, and the certificate as far as it is.
/**
 * @param {PageElement} root
 * @param {import("./live_preview.js").LivePreview} preview
 * @param {import("./scene_view.js").SceneView} sceneView
 * @param {import("./validation_view.js").ValidationView} validation
 * @param {(text: string) => void} report
 */
export function playbackInEditor(root, preview, sceneView, validation, report) {
  const certificate = root.querySelector("[data-plan-certificate]");
  return new PlanPlayback({
    isAvailable: () => preview.started.then(() => preview.isAvailable),
    show: (instant) => {
      if (!sceneView.isReady || validation.phases.length === 0) return;
      root.dataset.playing = !instant ? "false" : instant.ghost ? "replay" : instant.poses ? "body" : "path";
      validation.showInstant(instant);
    },
    report,
    drawn: () => (sceneView.isReady ? sceneView.nodes.drawn() : Promise.resolve()),
    reportCertificate: (text, passed) => {
      certificate.textContent = text;
      certificate.className = `outcome${passed === null ? "" : ` outcome-${passed ? "passed" : "failed"}`}`;
      certificate.hidden = !text;
    },
  });
}

export class PlanPlayback {
  // `isAvailable()` resolves to whether the service can plan at once; `show(instant)` draws an instant ({ phase, com_m, poses,
  // ghost }, the last two null before they are there), with null the end of the playback; `drawn()` resolves once it is on
  // the screen; `report(text)` shows a sentence, `reportCertificate(text, passed)` one about the certificate.
  /**
   * @param {{ isAvailable: () => Promise<boolean>, show: (instant: PlanInstant | null) => void, drawn: () => Promise<unknown>, report: (text: string) => void, reportCertificate: (text: string, passed: boolean | null) => void }} options
   */
  constructor({ isAvailable, show, drawn, report, reportCertificate }) {
    this.isAvailable = isAvailable;
    this.show = show;
    this.drawn = drawn;
    this.report = report;
    this.reportCertificate = reportCertificate;
    this.turn = 0;
    this.plan = new PartialPlan();
    this.reader = null;
    this.motion = null;
    /** @type {number[]} */
    this.ends_s = [];
    this.isPlaying = this.isStill = false;
    this.clock = new PlaybackClock();
  }

  // Plays the scenario until `stop`; with reduced motion, it shows only the latest posture of the body.
  /** @param {Scenario} scenario */
  async start(scenario) {
    this.stop();
    const turn = this.turn;
    this.ends_s = phaseEndTimes(scenario);
    this.isStill = matchMedia("(prefers-reduced-motion: reduce)").matches;
    if (!(await this.isAvailable())) return;
    const preview = await call("POST", "/plans/preview", { scenario }).catch((error) => error);
    if (turn !== this.turn) return;
    if (preview instanceof Error || !preview.motion.converged) return; // the job says why
    this.motion = preview.motion;
    if (this.plan.motion.time_s.length) return;
    this.report(
      `The centre of mass moves as planned, solved in ${(1e3 * preview.motion.solve_time_s).toFixed(0)} ms; the body takes ` +
        "the posture of each phase. Its motion is being computed.",
    );
    this.play();
  }

  // Shows the parts of a running job; `onEvent` is to be called at each of its events.
  /** @param {string} jobId */
  follow(jobId) {
    const turn = this.turn;
    this.plan = new PartialPlan();
    this.reader = new PartialReader(jobId, this.plan, () => {
      if (turn === this.turn) this.onParts();
    });
  }

  onEvent() {
    this.reader?.request();
  }

  // Resolves when the last parts of a job that has ended are shown, or after a while.
  async showLastParts() {
    await Promise.race([this.reader?.readLast(), new Promise((resolve) => setTimeout(resolve, LAST_PARTS_MS))]);
  }

  onParts() {
    const { plan } = this;
    this.reportCertificate(plan.certificateText, plan.passed);
    if (!plan.motion.time_s.length) return;
    if (plan.replay.time_s.length) this.report("The replay in physics is the blue figure, beside the planned motion.");
    else this.report("The body moves as far as it is solved.");
    this.play();
    if (this.clock.stage !== stageOf(plan)) this.draw(performance.now()); // not after the pause of slow pictures
  }

  play() {
    if (this.isPlaying) return;
    this.isPlaying = true;
    const turn = this.turn;
    const step = () => {
      if (turn !== this.turn) return;
      const begun_ms = performance.now();
      this.draw(begun_ms);
      if (this.isStill && !this.plan.motion.time_s.length) {
        this.isPlaying = false;
        return;
      }
      this.drawn().then(() => {
        const took_ms = performance.now() - begun_ms;
        setTimeout(step, took_ms < QUICK_MS ? 0 : Math.min(took_ms * (1 / SHARE - 1), LONGEST_PAUSE_MS));
      });
    };
    step();
  }

  /** @param {number} now_ms */
  draw(now_ms) {
    const { plan, motion } = this;
    const ends_s = plan.phaseEnds_s.length ? plan.phaseEnds_s : this.ends_s,
      duration_s = ends_s[ends_s.length - 1];
    const t_s = this.isStill ? (plan.motion.time_s.at(-1) ?? 0) : this.clock.advance(now_ms, plan, duration_s);
    const phase = ends_s.findIndex((end_s) => t_s < end_s);
    this.show({
      phase: phase < 0 ? ends_s.length - 1 : phase,
      com_m: motion ? comAt(motion, t_s) : null,
      poses: posesAt(plan.motion, t_s),
      ghost: plan.replay.time_s.length ? posesAt(plan.replay, t_s) : null,
    });
  }

  stop() {
    this.turn += 1;
    this.reader?.stop();
    this.isPlaying = false;
    this.motion = this.reader = null;
    this.plan = new PartialPlan();
    this.clock = new PlaybackClock();
    this.report("");
    this.reportCertificate("", null);
    this.show(null);
  }
}

/** @param {PartialPlan} plan */
const stageOf = (plan) => (plan.replay.time_s.length ? "replay" : plan.motion.time_s.length ? "body" : "path");

// The time of a playback: it runs as the clock does, waits for what is not there yet, and begins anew when the body appears,
// when its replay appears, and after the end of the motion.
export class PlaybackClock {
  constructor() {
    this.t_s = 0;
    this.stage = "";
    /** @type {number | null} */
    this.last_ms = null;
    /** @type {number | null} */
    this.ended_ms = null;
  }

  /** @param {number} now_ms @param {PartialPlan} plan @param {number} duration_s @returns {number} seconds */
  advance(now_ms, plan, duration_s) {
    const stage = stageOf(plan);
    if (stage !== this.stage) Object.assign(this, { stage, t_s: 0, last_ms: now_ms, ended_ms: null });
    const until_s = Math.min(
      duration_s,
      stage === "path" ? duration_s : (plan.motion.time_s.at(-1) ?? 0),
      stage === "replay" ? (plan.replay.time_s.at(-1) ?? 0) : duration_s,
    );
    const passed_s = (now_ms - (this.last_ms ?? now_ms)) / 1000;
    this.last_ms = now_ms;
    this.t_s = Math.min(this.t_s + passed_s, until_s);
    if (this.t_s >= duration_s - 0.05) {
      this.ended_ms ??= now_ms;
      if (now_ms - this.ended_ms >= PAUSE_MS) Object.assign(this, { t_s: 0, ended_ms: null });
    }
    return this.t_s;
  }
}
