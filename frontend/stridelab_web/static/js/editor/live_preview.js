// Plans a scenario anew while it is changed: one question at a time, and the latest wins; a push, and what follows it.
import { call } from "../shared/api.js";
import { counted } from "../shared/plurals.js";
import { LIVE, showLive } from "./live_preview_view.js";

export { LIVE };
const PAUSE_MS = 20;
const NO_SOLVER = "solver-unavailable";

export class Live {
  constructor(root) {
    const part = (name) => root.querySelector(`[data-${name}]`);
    this.root = root;
    this.box = part("live-box");
    this.on = part("live-on");
    this.said = part("live-said");
    this.form = part("push");
    this.nodes = null;
    this.body = null;
    this.next = false;
    this.busy = false;
    this.push = null;
    this.there = false;
    this.pushSaid = part("push-said");
    this.on.addEventListener("change", () => this.changed());
    this.form.addEventListener("submit", (event) => {
      event.preventDefault();
      this.push = pushOf(this.form);
      this.ask();
    });
    this.form.addEventListener("reset", () => {
      this.push = null;
      this.ask();
    });
    this.form.elements.cause.addEventListener("change", () => this.units());
    this.units();
  }

  // Asks which solvers there are; without the C++ one the page says so, and plans by the button alone.
  async start(nodes) {
    this.nodes = nodes;
    this.say("Starting the planner…");
    const known = await call("GET", "/solvers").catch((error) => error);
    const native = known instanceof Error ? null : known.solvers.find((solver) => solver.name === "native");
    this.there = Boolean(native?.available);
    for (const field of [this.on, ...this.form.elements]) field.disabled = !this.there;
    this.on.checked = this.there;
    this.root.dataset.live = this.there ? "there" : "missing";
    if (!this.there)
      this.say(`No plan while you drag: ${native ? native.missing : known.message} The button plans all the same.`);
    this.changed();
  }

  follow(body) {
    this.body = body;
    this.ask();
  }

  changed() {
    if (this.on.checked) return void this.ask();
    if (this.there) this.say("");
    if (this.nodes?.viser) showLive(this.nodes, null, null);
  }

  units() {
    const force = this.form.elements.cause.value === "force";
    for (const label of this.form.querySelectorAll("[data-unit]")) label.textContent = force ? "N" : "m/s";
    this.form.querySelector("[data-for]").hidden = !force;
  }

  ask() {
    this.next = this.there && this.on.checked && this.body !== null;
    if (this.next && !this.busy) this.work();
  }

  async work() {
    this.busy = true;
    while (this.next) {
      this.next = false;
      const push = this.push,
        began = performance.now();
      const answer = await call("POST", "/plans/preview", { scenario: this.body, ...(push && { push }) }).catch(
        (error) => error,
      );
      this.hear(answer, push, performance.now() - began);
      await new Promise((done) => setTimeout(done, PAUSE_MS));
    }
    this.busy = false;
  }

  hear(answer, push, took_ms) {
    const refused = answer instanceof Error;
    if (this.on.checked && this.nodes.viser) showLive(this.nodes, refused ? null : answer, push);
    this.root.dataset.lived = String(Number(this.root.dataset.lived ?? 0) + 1); // what tests wait for
    if (refused) {
      if (/** @type {any} */ (answer).problem?.code === NO_SOLVER) this.there = false;
      this.say(answer.message);
      this.pushSaid.textContent = "";
      return;
    }
    const { motion, recovered } = answer;
    const effort = (one) =>
      `cost ${one.objective.toFixed(2)}, ${counted(one.iterations, "iteration")}, solved in ${(1e3 * one.solve_time_s).toFixed(1)} ms`;
    // What the judge refuses is said below the scene already.
    if (answer.errors.length) this.say("No plan: the contacts are not valid.");
    else
      this.say(
        motion.converged ? `${effort(motion)}; answered in ${took_ms.toFixed(0)} ms` : `No motion: ${motion.status}`,
      );
    if (!recovered) this.pushSaid.textContent = push && !motion.converged ? "There is no motion to push." : "";
    else
      this.pushSaid.textContent = recovered.converged
        ? `It recovers: ${effort(recovered)}.`
        : `It does not recover: ${recovered.status}`;
  }

  say(text) {
    this.said.textContent = text;
  }
}

// What the fields say, in the service's terms.
function pushOf(form) {
  const number = (name) => form.elements[name].valueAsNumber || 0;
  const v = ["x", "y", "z"].map(number);
  const time_s = number("time");
  return form.elements.cause.value === "force"
    ? { time_s, force_n: v, duration_s: number("duration") }
    : { time_s, velocity_m_s: v };
}
