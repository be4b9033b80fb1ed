// The CoM's way as it would be planned now, and after a push, in the scene of a scenario.
import { HIDDEN } from "../viewer/viser_nodes.js";

const [PLANNED, RECOVERED, PUSH] = ["planned", "recovered", "push"].map((name) => `/live/${name}`);
export const LIVE = [PLANNED, RECOVERED, PUSH]; // viewer/overlays.py makes them
const RINGS = 160,
  SIDES = 6; // as many as the viewer gave the tubes
const RADIUS_M = 0.008,
  PUSH_RADIUS_M = 0.012,
  PUSH_M_PER_M_S = 1.5,
  PUSH_M_PER_NS = 0.015,
  SHORTEST_M = 0.06;

// Draws the answer of /plans/preview; `push` is what was asked for, or null. Without an answer, nothing.
export function showLive(nodes, preview, push) {
  const planned = preview?.motion.converged ? preview.motion : null;
  const recovered = preview?.recovered?.converged ? preview.recovered : null;
  draw(nodes, PLANNED, planned && tube(even(planned.com_m, RINGS), RADIUS_M));
  draw(nodes, RECOVERED, recovered && tube(even(recovered.com_m, RINGS), RADIUS_M));
  draw(nodes, PUSH, planned && push && tube(arrow(at(planned, push.time_s), push), PUSH_RADIUS_M));
  for (const [k, name] of LIVE.entries()) nodes.over(name, k + 1);
  nodes.draw();
}

function draw(nodes, name, points) {
  if (points) nodes.reshape(name, points);
  nodes.scale(name, points ? 1 : HIDDEN);
}

// From the CoM's place to where the push points, as long as it is strong.
function arrow(from, push) {
  const [v, scale] = push.velocity_m_s
    ? [push.velocity_m_s, PUSH_M_PER_M_S]
    : [push.force_n, PUSH_M_PER_NS * push.duration_s];
  const length = Math.hypot(...v) * scale;
  const by = length > 0 ? Math.max(length, SHORTEST_M) / Math.hypot(...v) : 0;
  return [from, from.map((x, i) => x + by * v[i])];
}

// Where the CoM of a motion is at a time.
function at(motion, t_s) {
  const k = Math.max(
    motion.time_s.findIndex((t) => t >= t_s),
    1,
  );
  const [a, b] = [motion.time_s[k - 1], motion.time_s[k]];
  const part = Math.min(Math.max((t_s - a) / (b - a), 0), 1);
  return motion.com_m[k - 1].map((x, i) => (1 - part) * x + part * motion.com_m[k][i]);
}

// `n` points on a line through points, equally far in their count.
function even(points, n) {
  return Array.from({ length: n }, (_, i) => {
    const where = (i * (points.length - 1)) / (n - 1);
    const k = Math.min(Math.floor(where), Math.max(points.length - 2, 0)),
      part = where - k;
    const [a, b] = [points[k], points[Math.min(k + 1, points.length - 1)]];
    return a.map((x, j) => (1 - part) * x + part * b[j]);
  });
}

// The corners of a thin tube, ring by ring (viewer/meshes.py).
function tube(path, radius) {
  return path.flatMap((p, i) => {
    const [a, b] = [path[Math.max(i - 1, 0)], path[Math.min(i + 1, path.length - 1)]];
    const t = unit([0, 1, 2].map((j) => b[j] - a[j]));
    const helper = Math.abs(t[2]) < 0.9 ? [0, 0, 1] : [1, 0, 0];
    const first = unit(cross(helper, t)),
      second = cross(t, first);
    return Array.from({ length: SIDES }, (_, k) => {
      const [c, s] = [Math.cos((2 * Math.PI * k) / SIDES), Math.sin((2 * Math.PI * k) / SIDES)];
      return p.map((x, j) => x + radius * (c * first[j] + s * second[j]));
    });
  });
}

const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];

function unit(v) {
  const norm = Math.hypot(...v);
  return norm > 1e-9 ? v.map((x) => x / norm) : [1, 0, 0];
}
