// Draws the support region, the CoM position with the largest margin and the contacts of the chosen phase into the scene.
import { HIDDEN } from "../viewer/viser_nodes.js";

const [REGION, EDGE, PLUMB, COM] = ["region", "edge", "plumb", "com"].map((name) => `/support/${name}`);
export const PLUMB_NODE = PLUMB;
export const SUPPORT_NODES = [REGION, EDGE, PLUMB, COM, `${COM}/light`]; // viewer/scenario_scene.py makes them
const CORNERS = 64; // vertices of the region's mesh in the viewer; the mesh of its edge has twice as many
const CLEARANCE_M = 0.01,
  EDGE_WIDTH_M = 0.008,
  MIN_MITRE = 0.25;
const CHOSEN_SCALE = 1.3,
  ERROR_RGB = [176, 0, 32];
const ACTIVE_OPACITY = { area: 0.75, edge: 1 },
  INACTIVE_OPACITY = { area: 0.15, edge: 0.4 };

// Draws the support of a phase (`phaseStates` in validation_text.js); what the phase lacks is hidden.
/** @param {import("../viewer/viser_nodes.js").ViserNodes} nodes @param {PhaseState} phase */
export function drawSupport(nodes, phase) {
  const floor_m = Math.min(...phase.contacts.map((contact) => contact.position_m[2])) + CLEARANCE_M;
  const corners = limitCorners(phase.region_m);
  const isDrawn = corners.length >= 3 && Number.isFinite(floor_m);
  if (isDrawn) {
    const outer = offsetOutwards(corners);
    const flat = (/** @type {number[][]} */ points) => points.map(([x, y]) => [x, y, floor_m]);
    nodes.setVertices(REGION, flat(padCorners(corners)));
    nodes.setVertices(EDGE, [...flat(padCorners(outer)), ...flat(padCorners(corners))]);
  }
  for (const name of [REGION, EDGE]) nodes.setScale(name, isDrawn ? 1 : HIDDEN);
  const com = phase.com_m;
  for (const name of [COM, PLUMB]) nodes.setScale(name, com ? 1 : HIDDEN);
  if (com) {
    nodes.setPose(COM, [...com]);
    nodes.setPose(PLUMB, [com[0], com[1], floor_m]);
    nodes.setScale(PLUMB, 1, 1, Math.max(com[2] - floor_m, HIDDEN));
  }
  // The region between two stairs lies inside the upper one, so it is drawn in front of everything.
  for (const [k, name] of SUPPORT_NODES.entries()) nodes.drawInFront(name, k + 1);
}

// Highlights the marks of phase `k`, colours those whose numbers are in `invalid`, and widens the edge of the chosen one.
/**
 * @param {import("../viewer/viser_nodes.js").ViserNodes} nodes
 * @param {Touch[]} touches
 * @param {number} k
 * @param {number | null} chosen
 * @param {Set<number>} invalid
 */
export function drawContactMarks(nodes, touches, k, chosen, invalid) {
  for (const touch of touches) {
    const isInvalid = invalid.has(touch.number);
    const opacity = isInvalid || (touch.phases[0] <= k && k <= touch.phases[1]) ? ACTIVE_OPACITY : INACTIVE_OPACITY;
    nodes.setColor(touch.node, isInvalid ? ERROR_RGB : null, opacity.area);
    nodes.setColor(`${touch.node}/edge`, isInvalid ? ERROR_RGB : null, opacity.edge);
    nodes.setScale(`${touch.node}/edge`, touch.number === chosen ? CHOSEN_SCALE : 1);
  }
}

// At most CORNERS corners of a polygon, counterclockwise.
/** @param {number[][]} corners */
function limitCorners(corners) {
  const n = Math.min(corners.length, CORNERS);
  const selected = Array.from({ length: n }, (_, i) => corners[Math.floor((i * corners.length) / n)]);
  const area = selected.reduce(
    (sum, [x, y], i) => sum + x * selected[(i + 1) % n][1] - y * selected[(i + 1) % n][0],
    0,
  );
  return area < 0 ? selected.reverse() : selected;
}

const padCorners = (/** @type {number[][]} */ corners) =>
  Array.from({ length: CORNERS }, (_, i) => corners[Math.min(i, corners.length - 1)]);

// The corners of a counterclockwise polygon whose edges are moved outwards by the width of the line.
/** @param {number[][]} corners */
function offsetOutwards(corners) {
  const n = corners.length;
  const normals = corners.map(([x, y], i) => {
    const [u, v] = [corners[(i + 1) % n][0] - x, corners[(i + 1) % n][1] - y];
    const length = Math.hypot(u, v) || 1;
    return [v / length, -u / length];
  });
  return corners.map(([x, y], i) => {
    const [a, b] = normals[(i + n - 1) % n],
      [c, d] = normals[i];
    const distance = EDGE_WIDTH_M / Math.max(1 + a * c + b * d, MIN_MITRE);
    return [x + distance * (a + c), y + distance * (b + d)];
  });
}
