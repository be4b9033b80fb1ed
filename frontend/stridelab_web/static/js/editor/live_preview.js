// Plans the scenario while it is edited, with a push on demand, and draws the CoM paths into the scene: one request at a
// time; of those that wait, only the latest.
import { call, isUnanswered } from "../shared/api.js";
import { untilAnswering } from "../shared/connection_notice.js";
import { counted } from "../shared/plurals.js";
import { HIDDEN } from "../viewer/viser_nodes.js";

const [PLANNED, RECOVERED, PUSH] = ["planned", "recovered", "push"].map((name) => `/live/${name}`);
export const PREVIEW_NODES = [PLANNED, RECOVERED, PUSH]; // made by viewer/scenario_scene.py
const RING_COUNT = 160,
  SIDE_COUNT = 6; // the rings and sides of the tubes in the viewer
const RADIUS_M = 0.008,
  PUSH_RADIUS_M = 0.012,
  PUSH_M_PER_M_S = 1.5,
  PUSH_M_PER_NS = 0.015,
  MIN_PUSH_LENGTH_M = 0.06;
const PAUSE_MS = 20;
const NO_SOLVER = "solver-unavailable";

export class LivePreview {
  /** @param {PageElement} root */
  constructor(root) {
    const part = (/** @type {string} */ name) => root.querySelector(`[data-${name}]`);
    this.root = root;
    this.box = part("live-box");
    this.checkbox = part("live-on");
    this.status = part("live-said");
    this.form = part("push");
    this.nodes = null;
    this.scenario = null;
    this.isRequested = false;
    this.isBusy = false;
    this.push = null;
    this.isAvailable = false;
    /** @type {Promise<void>} */
    this.started = new Promise((resolve) => {
      this.resolveStarted = resolve;
    });
    this.pushStatus = part("push-said");
    this.checkbox.addEventListener("change", () => this.onToggle());
    this.form.addEventListener("submit", (event) => {
      event.preventDefault();
      this.push = pushFromForm(this.form);
      this.request();
    });
    this.form.addEventListener("reset", () => {
      this.push = null;
      this.request();
    });
    this.form.elements.cause.addEventListener("change", () => this.showUnits());
    this.showUnits();
  }

  // Reads which solvers there are; without the C++ solver the preview is off.
  /** @param {import("../viewer/viser_nodes.js").ViserNodes} nodes */
  async start(nodes) {
    this.nodes = nodes;
    this.setStatus("Starting the planner…");
    const read = () => call("GET", "/solvers").catch((error) => error);
    let solvers = await read();
    while (isUnanswered(solvers)) {
      await untilAnswering();
      solvers = await read();
    }
    const native =
      solvers instanceof Error
        ? null
        : solvers.solvers.find((/** @type {{ name: string }} */ solver) => solver.name === "native");
    this.isAvailable = Boolean(native?.available);
    this.resolveStarted();
    for (const field of [this.checkbox, ...this.form.elements]) field.disabled = !this.isAvailable;
    this.checkbox.checked = this.isAvailable;
    this.root.dataset.live = this.isAvailable ? "there" : "missing";
    if (!this.isAvailable)
      this.setStatus(
        `No plan while you drag: ${native ? native.missing : solvers.message} The Plan button works nevertheless.`,
      );
    this.onToggle();
  }

  /** @param {Scenario} scenario */
  update(scenario) {
    this.scenario = scenario;
    this.request();
  }

  onToggle() {
    if (this.checkbox.checked) return void this.request();
    if (this.isAvailable) this.setStatus("");
    if (this.nodes?.viser) drawPreview(this.nodes, null, null);
  }

  showUnits() {
    const isForce = this.form.elements.cause.value === "force";
    for (const label of this.form.querySelectorAll("[data-unit]")) label.textContent = isForce ? "N" : "m/s";
    this.form.querySelector("[data-for]").hidden = !isForce;
  }

  request() {
    this.isRequested = this.isAvailable && this.checkbox.checked && this.scenario !== null;
    if (this.isRequested && !this.isBusy) this.run();
  }

  async run() {
    this.isBusy = true;
    while (this.isRequested) {
      this.isRequested = false;
      const push = this.push,
        began = performance.now();
      const result = await call("POST", "/plans/preview", { scenario: this.scenario, ...(push && { push }) }).catch(
        (error) => error,
      );
      if (isUnanswered(result)) {
        await untilAnswering();
        this.request(); // of what is edited by then
        continue;
      }
      this.showResult(result, push, performance.now() - began);
      await new Promise((done) => setTimeout(done, PAUSE_MS));
    }
    this.isBusy = false;
  }

  /** @param {Api.PlanPreview | Error} result @param {object | null} push @param {number} took_ms */
  showResult(result, push, took_ms) {
    const preview = result instanceof Error ? null : result;
    if (this.checkbox.checked && this.nodes?.viser) drawPreview(this.nodes, preview, push);
    this.root.dataset.lived = String(Number(this.root.dataset.lived ?? 0) + 1); // what tests wait for
    if (result instanceof Error) {
      if (/** @type {any} */ (result).problem?.code === NO_SOLVER) this.isAvailable = false;
      this.setStatus(result.message);
      showText(this.pushStatus, "");
      return;
    }
    const { motion, recovered } = result;
    const describe = (/** @type {Api.PreviewMotion} */ solution) =>
      `cost ${(solution.objective ?? NaN).toFixed(2)}, ${counted(solution.iterations, "iteration")}, solved in ${(1e3 * solution.solve_time_s).toFixed(1)} ms`;
    // Validation errors are shown below the scene already.
    if (result.errors.length) this.setStatus("No plan: the contacts are not valid.");
    else if (motion.converged)
      this.setStatus(
        "The centre of mass can move along the drawn path.",
        `${describe(motion)}; answered in ${took_ms.toFixed(0)} ms`,
      );
    else this.setStatus(`The centre of mass has no motion: ${motion.status}`);
    if (!recovered) showText(this.pushStatus, push && !motion.converged ? "There is no motion to push." : "");
    else if (recovered.converged) showText(this.pushStatus, "It recovers from the push.", describe(recovered));
    else showText(this.pushStatus, `It does not recover from the push: ${recovered.status}`);
  }

  /** @param {string} text @param {string} [details] */
  setStatus(text, details) {
    showText(this.status, text, details);
  }
}

// A sentence for readers, and the numbers of the solver as its tooltip.
/** @param {PageElement} place @param {string} text @param {string} [details] */
function showText(place, text, details = "") {
  place.textContent = text;
  place.title = details;
}

// The push of the form's fields, as the service takes it.
/** @param {PageElement} form */
function pushFromForm(form) {
  const number = (/** @type {string} */ name) => form.elements[name].valueAsNumber || 0;
  const v = ["x", "y", "z"].map(number);
  const time_s = number("time");
  return form.elements.cause.value === "force"
    ? { time_s, force_n: v, duration_s: number("duration") }
    : { time_s, velocity_m_s: v };
}

// Draws the result of /plans/preview for a push, or null for none; hides everything without a result.
/**
 * @param {import("../viewer/viser_nodes.js").ViserNodes} nodes
 * @param {Api.PlanPreview | null} preview
 * @param {any} push
 */
function drawPreview(nodes, preview, push) {
  const planned = preview?.motion.converged ? preview.motion : null;
  const recovered = preview?.recovered?.converged ? preview.recovered : null;
  drawTube(nodes, PLANNED, planned && tubeVertices(resample(planned.com_m, RING_COUNT), RADIUS_M));
  drawTube(nodes, RECOVERED, recovered && tubeVertices(resample(recovered.com_m, RING_COUNT), RADIUS_M));
  drawTube(nodes, PUSH, planned && push && tubeVertices(pushArrow(comAt(planned, push.time_s), push), PUSH_RADIUS_M));
  for (const [k, name] of PREVIEW_NODES.entries()) nodes.drawInFront(name, k + 1);
  nodes.draw();
}

/** @param {import("../viewer/viser_nodes.js").ViserNodes} nodes @param {string} name @param {number[][] | null} points */
function drawTube(nodes, name, points) {
  if (points) nodes.setVertices(name, points);
  nodes.setScale(name, points ? 1 : HIDDEN);
}

// An arrow from the position of the CoM along the push, with a length in proportion to its strength.
/** @param {number[]} from @param {any} push */
function pushArrow(from, push) {
  const [v, scale] = push.velocity_m_s
    ? [push.velocity_m_s, PUSH_M_PER_M_S]
    : [push.force_n, PUSH_M_PER_NS * push.duration_s];
  const length = Math.hypot(...v) * scale;
  const factor = length > 0 ? Math.max(length, MIN_PUSH_LENGTH_M) / Math.hypot(...v) : 0;
  return [from, from.map((x, i) => x + factor * v[i])];
}

// The position of the CoM of a motion at a time.
/** @param {{ time_s: number[], com_m: number[][] }} motion @param {number} t_s */
export function comAt(motion, t_s) {
  const k = Math.max(
    motion.time_s.findIndex((t) => t >= t_s),
    1,
  );
  const [a, b] = [motion.time_s[k - 1], motion.time_s[k]];
  const fraction = Math.min(Math.max((t_s - a) / (b - a), 0), 1);
  return motion.com_m[k - 1].map((x, i) => (1 - fraction) * x + fraction * motion.com_m[k][i]);
}

// `n` points on a polyline, at equal steps of its parameter.
/** @param {number[][]} points @param {number} n */
function resample(points, n) {
  return Array.from({ length: n }, (_, i) => {
    const position = (i * (points.length - 1)) / (n - 1);
    const k = Math.min(Math.floor(position), Math.max(points.length - 2, 0)),
      fraction = position - k;
    const [a, b] = [points[k], points[Math.min(k + 1, points.length - 1)]];
    return a.map((x, j) => (1 - fraction) * x + fraction * b[j]);
  });
}

// The vertices of a thin tube along a path, ring by ring (viewer/meshes.py).
/** @param {number[][]} path @param {number} radius */
function tubeVertices(path, radius) {
  return path.flatMap((p, i) => {
    const [a, b] = [path[Math.max(i - 1, 0)], path[Math.min(i + 1, path.length - 1)]];
    const t = normalize([0, 1, 2].map((j) => b[j] - a[j]));
    const helper = Math.abs(t[2]) < 0.9 ? [0, 0, 1] : [1, 0, 0];
    const first = normalize(cross(helper, t)),
      second = cross(t, first);
    return Array.from({ length: SIDE_COUNT }, (_, k) => {
      const [c, s] = [Math.cos((2 * Math.PI * k) / SIDE_COUNT), Math.sin((2 * Math.PI * k) / SIDE_COUNT)];
      return p.map((x, j) => x + radius * (c * first[j] + s * second[j]));
    });
  });
}

const cross = (/** @type {number[]} */ a, /** @type {number[]} */ b) => [
  a[1] * b[2] - a[2] * b[1],
  a[2] * b[0] - a[0] * b[2],
  a[0] * b[1] - a[1] * b[0],
];

/** @param {number[]} v */
function normalize(v) {
  const norm = Math.hypot(...v);
  return norm > 1e-9 ? v.map((x) => x / norm) : [1, 0, 0];
}
