// Edits of a scenario's terrain: its surfaces as numbers, and copies of the scenario with a changed surface. Contacts on a
// surface move with it.
import { conjugate, fromAngles, multiply, rotate, toAngles } from "../viewer/quaternions.js";
import { partAlongRail, pointOnRail } from "./phase_edits.js";

const DEGREE = Math.PI / 180,
  ON_FACE_M = 2e-3, // a contact at most this far from a surface is on it
  MAX_NAME_LENGTH = 60;

const LEAST_M = 0.001;

/** @typedef {{ name: string, label: string, unit: string, step: number, min?: number }} SurfaceField */
/** @type {Record<Surface["kind"], SurfaceField[]>} */
export const SURFACE_FIELDS = {
  box: [
    { name: "x", label: "x", unit: "m", step: 0.05 },
    { name: "y", label: "y", unit: "m", step: 0.05 },
    { name: "top", label: "top", unit: "m", step: 0.01 },
    { name: "length", label: "length", unit: "m", step: 0.05, min: LEAST_M },
    { name: "width", label: "width", unit: "m", step: 0.05, min: LEAST_M },
    { name: "height", label: "height", unit: "m", step: 0.05, min: LEAST_M },
    { name: "turn", label: "turn", unit: "°", step: 5 },
    { name: "slope", label: "slope", unit: "°", step: 1 },
    { name: "lean", label: "lean", unit: "°", step: 1 },
  ],
  rail: [
    { name: "x1", label: "from x", unit: "m", step: 0.05 },
    { name: "x2", label: "to x", unit: "m", step: 0.05 },
    { name: "y1", label: "from y", unit: "m", step: 0.05 },
    { name: "y2", label: "to y", unit: "m", step: 0.05 },
    { name: "z1", label: "from z", unit: "m", step: 0.05 },
    { name: "z2", label: "to z", unit: "m", step: 0.05 },
    { name: "radius", label: "radius", unit: "m", step: 0.005, min: LEAST_M },
  ],
};

/** @param {number} value */
const round = (value) => Math.round(value * 1e6) / 1e6;
/** @param {Box} box */
const orientationOf = (box) => box.orientation_wxyz ?? fromAngles(box.yaw_rad ?? 0, 0, 0);

// The numbers of a surface by the names of its fields: of a box those of its upper face, with its height below it.
/** @param {Surface} surface @returns {Record<string, number>} */
export function surfaceNumbers(surface) {
  if (surface.kind === "rail") {
    const [x1, y1, z1] = surface.from_m,
      [x2, y2, z2] = surface.to_m;
    return { x1, y1, z1, x2, y2, z2, radius: surface.radius_m };
  }
  const wxyz = orientationOf(surface);
  const [length, width, height] = surface.size_m;
  const up = rotate(wxyz, [0, 0, height / 2]);
  const [x, y, top] = surface.center_m.map((v, i) => round(v + up[i]));
  const [turn, slope, lean] = toAngles(wxyz).map((angle) => round(angle / DEGREE));
  return { x, y, top, length, width, height, turn, slope, lean };
}

// The surface with one number changed.
/** @template {Surface} S @param {S} surface @param {string} name @param {number} value @returns {S} */
export function setSurfaceNumber(surface, name, value) {
  const n = { ...surfaceNumbers(surface), [name]: value };
  if (surface.kind === "rail")
    return { ...surface, from_m: [n.x1, n.y1, n.z1], to_m: [n.x2, n.y2, n.z2], radius_m: n.radius };
  const wxyz = fromAngles(n.turn * DEGREE, n.slope * DEGREE, n.lean * DEGREE);
  const up = rotate(wxyz, [0, 0, n.height / 2]);
  const isLevel = n.slope === 0 && n.lean === 0;
  return {
    ...surface,
    center_m: [n.x, n.y, n.top].map((v, i) => round(v - up[i])),
    size_m: [n.length, n.width, n.height],
    yaw_rad: isLevel ? n.turn * DEGREE : null,
    orientation_wxyz: isLevel ? null : wxyz,
  };
}

// The contact after its surface has changed; null if it is not on the surface.
/** @param {Contact} contact @param {Surface} before @param {Surface} after @returns {Contact | null} */
export function carryContact(contact, before, after) {
  if (before.kind === "rail" && after.kind === "rail") {
    const part = partAlongRail(before, contact.position_m);
    const [nearest] = pointOnRail(before, part);
    if (Math.hypot(...nearest.map((v, i) => v - contact.position_m[i])) > 2 * before.radius_m + ON_FACE_M) return null;
    const [position_m, { orientation_wxyz }] = pointOnRail(after, part);
    return { ...contact, position_m: position_m.map(round), orientation_wxyz };
  }
  if (before.kind !== "box" || after.kind !== "box") return null;
  const [from, to] = [before, after].map(orientationOf);
  const offset = contact.position_m.map((v, i) => v - before.center_m[i]);
  const local = rotate(conjugate(from), offset);
  const beyond = local.map((v, i) => Math.abs(v) - before.size_m[i] / 2);
  if (Math.max(...beyond) > ON_FACE_M || Math.max(...beyond) < -ON_FACE_M) return null;
  const placed = local.map((v, i) => (beyond[i] > -ON_FACE_M ? (Math.sign(v) * after.size_m[i]) / 2 : v));
  const moved = rotate(to, placed);
  return {
    ...contact,
    position_m: after.center_m.map((v, i) => round(v + moved[i])),
    orientation_wxyz: multiply(multiply(to, conjugate(from)), contact.orientation_wxyz),
  };
}

// Replaces surface k; the contacts on it move with it.
/** @param {Scenario} scenario @param {number} k @param {Surface} after @returns {Scenario} */
export function replaceSurface(scenario, k, after) {
  const before = scenario.terrain[k];
  const carry = (/** @type {Contact} */ contact) => carryContact(contact, before, after) ?? contact;
  return {
    ...scenario,
    terrain: scenario.terrain.with(k, after),
    phases: scenario.phases.map((phase) => ({ ...phase, contacts: phase.contacts.map(carry) })),
  };
}

/** @param {Scenario} scenario @param {number} k @returns {Scenario} */
export const removeSurface = (scenario, k) => ({ ...scenario, terrain: scenario.terrain.toSpliced(k, 1) });

// A new surface ahead of (box) or beside (wall, rail) the contacts, under a name of its own.
/** @param {Scenario} scenario @param {"box" | "wall" | "rail"} kind @returns {Scenario} */
export function addSurface(scenario, kind) {
  const points = scenario.phases.flatMap((phase) => phase.contacts.map((contact) => contact.position_m));
  const [ends, sides, heights] = [0, 1, 2].map((i) => points.map((point) => point[i]));
  const [first, last] = [Math.min(...ends), Math.max(...ends)];
  const name = freeName(scenario.terrain, kind);
  /** @param {number[]} center_m @param {number[]} size_m @returns {Box} */
  const box = (center_m, size_m) => ({ kind: "box", name, center_m: center_m.map(round), size_m: size_m.map(round) });
  const middle = (first + last) / 2,
    length_m = last - first + 1,
    ground_m = Math.min(...heights);
  /** @type {Record<string, () => Surface>} */
  const made = {
    box: () => box([last + 0.6, 0, ground_m], [0.4, 1, 0.2]),
    wall: () => box([middle, Math.max(...sides) + 0.6, ground_m + 0.8], [length_m, 0.1, 1.6]),
    rail: () => {
      const side_m = Math.min(...sides) - 0.5;
      const [from_m, to_m] = [first - 0.3, last + 0.5].map((x) => [x, side_m, ground_m + 0.9].map(round));
      return { kind: "rail", name, from_m, to_m, radius_m: 0.02 };
    },
  };
  return { ...scenario, terrain: [...scenario.terrain, made[kind]()] };
}

/** @param {Surface[]} terrain @param {string} kind */
function freeName(terrain, kind) {
  const taken = new Set(terrain.map(({ name }) => name));
  let number = 1;
  while (taken.has(`${kind} ${number}`)) number += 1;
  return `${kind} ${number}`.slice(0, MAX_NAME_LENGTH);
}
