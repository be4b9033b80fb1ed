// While a plan is computed, the centre of mass moves along its path, which is solved in milliseconds, and the body takes the
// posture of each phase. The motion of the body between the postures is what the plan computes.
import { call } from "../shared/api.js";
import { comAt } from "./live_preview.js";
import { phaseEndTimes } from "./phase_edits.js";

const SHARE = 1 / 3; // of the time that drawing may take: without a graphics card it slows the plan down

export class PlanPlayback {
  // `isAvailable()` resolves to whether the service can plan at once; `show(phase, com_m)` draws an instant, with null the end
  // of the playback; `report(text)` shows a sentence.
  constructor({ isAvailable, show, report }) {
    this.isAvailable = isAvailable;
    this.show = show;
    this.report = report;
    this.turn = 0;
  }

  // Plays the scenario once, or until `stop`; with reduced motion, only the path is shown.
  async start(scenario) {
    this.stop();
    const turn = this.turn;
    if (!(await this.isAvailable())) return;
    const preview = await call("POST", "/plans/preview", { scenario }).catch((error) => error);
    if (turn !== this.turn) return;
    if (preview instanceof Error || !preview.motion.converged) return; // the job says why
    const { motion } = preview;
    if (matchMedia("(prefers-reduced-motion: reduce)").matches) return;
    this.report(
      `The centre of mass moves as planned, solved in ${(1e3 * motion.solve_time_s).toFixed(0)} ms; the body takes the ` +
        "posture of each phase. Its motion is being computed.",
    );
    const ends_s = phaseEndTimes(scenario),
      began_ms = performance.now();
    const play = () => {
      if (turn !== this.turn) return;
      const t_s = Math.min((performance.now() - began_ms) / 1000, ends_s[ends_s.length - 1] - 1e-3),
        drawn_ms = performance.now();
      this.show(
        ends_s.findIndex((end_s) => t_s < end_s),
        comAt(motion, t_s),
      );
      if (t_s < ends_s[ends_s.length - 1] - 1e-3)
        requestAnimationFrame(() => setTimeout(play, (performance.now() - drawn_ms) * (1 / SHARE - 1)));
    };
    play();
  }

  stop() {
    this.turn += 1;
    this.report("");
    this.show(null, null);
  }
}
