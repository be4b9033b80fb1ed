// Edits of a scenario's phases: each function returns a copy of the scenario with other durations or contacts.
import { rotationFromZ } from "../viewer/quaternions.js";

const MIN_DURATION_S = 0.05,
  MAX_DURATION_S = 60;
const NEW_DURATION_S = 0.5,
  STRIDE_M = 0.2,
  HALF_STANCE_WIDTH_M = 0.18,
  HAND_OFFSET_M = [0.3, 0.4, 0.9];

/** @param {number} t_s */
const roundToMs = (t_s) => Math.round(t_s * 1000) / 1000;
/** @type {(a?: Contact | null, b?: Contact | null) => boolean} */
const equalContacts = (a, b) => Boolean(a && b) && JSON.stringify(a) === JSON.stringify(b);
/** @type {(scenario: Scenario, phases: Phase[]) => Scenario} */
const withPhases = (scenario, phases) => ({ ...scenario, phases });
/** @type {(scenario: Scenario, k: number, phase: Phase) => Scenario} */
const replacePhase = (scenario, k, phase) =>
  withPhases(
    scenario,
    scenario.phases.map((old, i) => (i === k ? phase : old)),
  );

// End times of the phases in seconds from the start.
/** @param {Scenario} scenario */
export function phaseEndTimes(scenario) {
  let t_s = 0;
  return scenario.phases.map((phase) => {
    t_s += phase.duration_s;
    return t_s;
  });
}

/** @type {(scenario: Scenario, k: number, effector: string) => Contact | null} */
export const contactInPhase = (scenario, k, effector) =>
  scenario.phases[k]?.contacts.find((contact) => contact.effector === effector) ?? null;

// The contact of a touch.
/** @type {(scenario: Scenario, touch: Touch) => Contact} */
export const contactOf = (scenario, touch) =>
  /** @type {Contact} */ (contactInPhase(scenario, touch.phases[0], touch.effector));

/** @type {(scenario: Scenario, k: number, duration_s: number) => Scenario} */
export const setDuration = (scenario, k, duration_s) =>
  replacePhase(scenario, k, {
    ...scenario.phases[k],
    duration_s: roundToMs(Math.min(Math.max(duration_s, MIN_DURATION_S), MAX_DURATION_S)),
  });

// Moves the end of phase k to a time. The next phase becomes shorter or longer; with `shiftLater`, later phases shift.
/** @param {Scenario} scenario @param {number} k @param {number} t_s @param {boolean} shiftLater */
export function movePhaseEnd(scenario, k, t_s, shiftLater) {
  const start_s = k > 0 ? phaseEndTimes(scenario)[k - 1] : 0,
    next = scenario.phases[k + 1];
  if (shiftLater || !next) return setDuration(scenario, k, t_s - start_s);
  const sum_s = scenario.phases[k].duration_s + next.duration_s;
  const low_s = Math.max(MIN_DURATION_S, sum_s - MAX_DURATION_S),
    high_s = Math.min(sum_s - MIN_DURATION_S, MAX_DURATION_S);
  if (low_s > high_s) return scenario;
  const first = setDuration(scenario, k, Math.min(Math.max(t_s - start_s, low_s), high_s));
  return setDuration(first, k + 1, sum_s - first.phases[k].duration_s);
}

/** @param {Scenario} scenario @param {number} k */
export function splitPhase(scenario, k) {
  const phase = scenario.phases[k],
    half_s = roundToMs(phase.duration_s / 2);
  if (half_s < MIN_DURATION_S)
    throw new Error(`Phase ${k} is too short to be split: both halves must last ${MIN_DURATION_S} s.`);
  const halves = [half_s, roundToMs(phase.duration_s - half_s)].map((duration_s) => ({ ...phase, duration_s }));
  return withPhases(scenario, scenario.phases.toSpliced(k, 1, ...halves));
}

// Inserts a phase with the same contacts after phase k.
/** @type {(scenario: Scenario, k: number) => Scenario} */
export const duplicatePhase = (scenario, k) =>
  withPhases(scenario, scenario.phases.toSpliced(k + 1, 0, { ...scenario.phases[k], duration_s: NEW_DURATION_S }));

/** @param {Scenario} scenario @param {number} k */
export function removePhase(scenario, k) {
  if (scenario.phases.length === 1) throw new Error("A scenario has at least one phase.");
  return withPhases(scenario, scenario.phases.toSpliced(k, 1));
}

// Replaces the contact of an effector in phase k; null removes it.
/** @param {Scenario} scenario @param {number} k @param {string} effector @param {Contact | null} contact */
export function setContact(scenario, k, effector, contact) {
  const here = scenario.phases[k].contacts,
    at = here.findIndex((one) => one.effector === effector);
  const contacts = at < 0 ? [...here] : here.toSpliced(at, 1);
  if (contact) contacts.splice(at < 0 ? contacts.length : at, 0, contact);
  return replacePhase(scenario, k, { ...scenario.phases[k], contacts });
}

// The contact of an effector in phase k (`here`) and the nearest ones before and after it with their phases, or null; and
// which of the choices "away", "before", "after" and "own" describes `here`.
/** @param {Scenario} scenario @param {number} k @param {string} effector */
export function contactChoices(scenario, k, effector) {
  /** @param {number[]} numbers */
  const find = (numbers) => {
    const at = numbers.find((i) => contactInPhase(scenario, i, effector));
    return at === undefined
      ? null
      : { phase: at, contact: /** @type {Contact} */ (contactInPhase(scenario, at, effector)) };
  };
  const here = contactInPhase(scenario, k, effector);
  const before = find(Array.from({ length: k }, (_, i) => k - 1 - i));
  const after = find(Array.from({ length: scenario.phases.length - k - 1 }, (_, i) => k + 1 + i));
  const chosen = !here
    ? "away"
    : equalContacts(here, before?.contact)
      ? "before"
      : equalContacts(here, after?.contact)
        ? "after"
        : "own";
  return { here, before, after: equalContacts(before?.contact, after?.contact) ? null : after, chosen };
}

// An initial contact for an effector without one in phase k: between its neighbours, beside the other foot, or on a rail.
/** @param {Scenario} scenario @param {number} k @param {string} effector */
export function suggestContact(scenario, k, effector) {
  const { before, after } = contactChoices(scenario, k, effector),
    nearest = before?.contact ?? after?.contact;
  /** @type {(position: number[], oriented?: { orientation_wxyz: number[] } | null) => Contact} */
  const contactAt = (position, oriented) => ({
    effector,
    position_m: position.map((v) => Math.round(v * 1e6) / 1e6),
    orientation_wxyz: oriented?.orientation_wxyz ?? [1, 0, 0, 0],
  });
  const left = effector.startsWith("left") ? 1 : -1,
    hand = effector.includes("hand");
  const feet = scenario.phases[k].contacts
    .filter((contact) => contact.effector.includes("foot"))
    .map((contact) => contact.position_m);
  const middle = [0, 1, 2].map((i) => feet.reduce((sum, foot) => sum + foot[i], 0) / Math.max(feet.length, 1));
  if (hand) {
    const rail = scenario.terrain.find((surface) => surface.kind === "rail");
    if (rail) return contactAt(...nearestOnRail(rail, nearest?.position_m ?? middle));
    return contactAt(
      nearest?.position_m ?? [
        middle[0] + HAND_OFFSET_M[0],
        middle[1] + left * HAND_OFFSET_M[1],
        middle[2] + HAND_OFFSET_M[2],
      ],
      nearest,
    );
  }
  let place = [middle[0], middle[1] + left * HALF_STANCE_WIDTH_M, middle[2]];
  if (before && after) place = [0, 1, 2].map((i) => (before.contact.position_m[i] + after.contact.position_m[i]) / 2);
  else if (nearest)
    place = [nearest.position_m[0] + (before ? STRIDE_M : -STRIDE_M), nearest.position_m[1], nearest.position_m[2]];
  return contactAt(
    [place[0], place[1], groundHeight(scenario.terrain, place)],
    nearest ?? scenario.phases[k].contacts[0],
  );
}

// The point on top of a rail that is nearest to `point`, and the orientation whose z axis is the normal of the rail.
/** @param {Rail} rail @param {number[]} point @returns {[number[], { orientation_wxyz: number[] }]} */
function nearestOnRail(rail, point) {
  return pointOnRail(rail, partAlongRail(rail, point));
}

// The part of a rail, from 0 to 1, at the foot of the perpendicular from a point.
/** @param {Rail} rail @param {number[]} point */
export function partAlongRail(rail, point) {
  const along = rail.to_m.map((v, i) => v - rail.from_m[i]);
  const square = along.reduce((sum, v) => sum + v * v, 0);
  const part = along.reduce((sum, v, i) => sum + v * (point[i] - rail.from_m[i]), 0) / square;
  return Math.min(Math.max(part, 0), 1);
}

// The point on top of a rail at a part of its length, and the orientation whose z axis is the normal of the rail.
/** @param {Rail} rail @param {number} at @returns {[number[], { orientation_wxyz: number[] }]} */
export function pointOnRail(rail, at) {
  const along = rail.to_m.map((v, i) => v - rail.from_m[i]);
  const square = along.reduce((sum, v) => sum + v * v, 0);
  const normal = [0, 1, 2].map((i) => (i === 2 ? 1 : 0) - (along[2] * along[i]) / square);
  const norm = Math.hypot(...normal);
  return [
    rail.from_m.map((v, i) => v + at * along[i] + (rail.radius_m * normal[i]) / norm),
    { orientation_wxyz: rotationFromZ(normal, norm) },
  ];
}

// Height of the highest level box at a place; the height of the place where there is none.
/** @param {Surface[]} terrain @param {number[]} place */
function groundHeight(terrain, place) {
  const [x, y, z] = place;
  const heights = terrain.flatMap((box) => {
    if (box.kind !== "box" || box.orientation_wxyz) return [];
    const c = Math.cos(box.yaw_rad ?? 0),
      s = Math.sin(box.yaw_rad ?? 0);
    const [u, v] = [x - box.center_m[0], y - box.center_m[1]];
    const isInside = Math.abs(c * u + s * v) <= box.size_m[0] / 2 && Math.abs(c * v - s * u) <= box.size_m[1] / 2;
    return isInside ? [box.center_m[2] + box.size_m[2] / 2] : [];
  });
  return heights.length ? Math.max(...heights) : z;
}
