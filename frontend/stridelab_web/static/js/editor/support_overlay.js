// The support region, the best place of the CoM and the contacts of the chosen phase, in the scene of a scenario.
import { HIDDEN } from "../viewer/viser_nodes.js";

const [REGION, EDGE, PLUMB, COM] = ["region", "edge", "plumb", "com"].map((name) => `/support/${name}`);
export const SUPPORT = [REGION, EDGE, PLUMB, COM, `${COM}/light`]; // viewer/overlays.py makes them
const CORNERS = 64; // as many as the viewer gave the region; its edge has twice as many
const LIFT_M = 0.01,
  WIDTH_M = 0.008,
  SHARPEST = 0.25;
const CHOSEN = 1.3,
  WARNING = [176, 0, 32];
const FULL = { area: 0.75, edge: 1 },
  PALE = { area: 0.15, edge: 0.4 };

// Draws what `phase` (verdict.js) can be held by; nothing of what it lacks.
export function showSupport(nodes, phase) {
  const floor_m = Math.min(...phase.contacts.map((contact) => contact.position_m[2])) + LIFT_M;
  const corners = thinned(phase.region_m);
  const there = corners.length >= 3 && Number.isFinite(floor_m);
  if (there) {
    const outer = outside(corners);
    const flat = (points) => points.map(([x, y]) => [x, y, floor_m]);
    nodes.reshape(REGION, flat(filled(corners)));
    nodes.reshape(EDGE, [...flat(filled(outer)), ...flat(filled(corners))]);
  }
  for (const name of [REGION, EDGE]) nodes.scale(name, there ? 1 : HIDDEN);
  const com = phase.com_m;
  for (const name of [COM, PLUMB]) nodes.scale(name, com ? 1 : HIDDEN);
  if (com) {
    nodes.pose(COM, [...com]);
    nodes.pose(PLUMB, [com[0], com[1], floor_m]);
    nodes.scale(PLUMB, 1, 1, Math.max(com[2] - floor_m, HIDDEN));
  }
  // A region between two stairs lies inside the upper one: it is drawn over all, and what tells where over that.
  for (const [k, name] of SUPPORT.entries()) nodes.over(name, k + 1);
}

// Marks of phase `k` stand out; those in `wrong` (numbers) warn; the chosen one has a wider edge.
export function showMarks(nodes, touches, k, chosen, wrong) {
  for (const touch of touches) {
    const bad = wrong.has(touch.number);
    const look = bad || (touch.phases[0] <= k && k <= touch.phases[1]) ? FULL : PALE;
    nodes.paint(touch.node, bad ? WARNING : null, look.area);
    nodes.paint(`${touch.node}/edge`, bad ? WARNING : null, look.edge);
    nodes.scale(`${touch.node}/edge`, touch.number === chosen ? CHOSEN : 1);
  }
}

// Of a polygon with more corners than there are vertices, every so many.
function thinned(corners) {
  const n = Math.min(corners.length, CORNERS);
  const found = Array.from({ length: n }, (_, i) => corners[Math.floor((i * corners.length) / n)]);
  const area = found.reduce((sum, [x, y], i) => sum + x * found[(i + 1) % n][1] - y * found[(i + 1) % n][0], 0);
  return area < 0 ? found.reverse() : found;
}

const filled = (corners) => Array.from({ length: CORNERS }, (_, i) => corners[Math.min(i, corners.length - 1)]);

// The corners of a polygon, counterclockwise, moved outward so that its edges move by the line's width.
function outside(corners) {
  const n = corners.length;
  const normals = corners.map(([x, y], i) => {
    const [u, v] = [corners[(i + 1) % n][0] - x, corners[(i + 1) % n][1] - y];
    const length = Math.hypot(u, v) || 1;
    return [v / length, -u / length];
  });
  return corners.map(([x, y], i) => {
    const [a, b] = normals[(i + n - 1) % n],
      [c, d] = normals[i];
    const by = WIDTH_M / Math.max(1 + a * c + b * d, SHARPEST);
    return [x + by * (a + c), y + by * (b + d)];
  });
}
