// Changes of a scenario's phases: each takes what is stored and gives the same with other durations or contacts.
import { towards } from "../viewer/quaternions.js";

const SHORTEST_S = 0.05,
  LONGEST_S = 60;
const ADDED_S = 0.5,
  STRIDE_M = 0.2,
  APART_M = 0.18,
  HAND_M = [0.3, 0.4, 0.9];

const toMs = (t_s) => Math.round(t_s * 1000) / 1000;
const sameContact = (a, b) => Boolean(a && b) && JSON.stringify(a) === JSON.stringify(b);
const withPhases = (body, phases) => ({ ...body, phases });
const replaced = (body, k, phase) =>
  withPhases(
    body,
    body.phases.map((old, i) => (i === k ? phase : old)),
  );

// When the phases end, in seconds from the start.
export function endsOf(body) {
  let t_s = 0;
  return body.phases.map((phase) => (t_s += phase.duration_s));
}

export const contactIn = (body, k, effector) =>
  body.phases[k]?.contacts.find((contact) => contact.effector === effector) ?? null;

export const lasting = (body, k, duration_s) =>
  replaced(body, k, { ...body.phases[k], duration_s: toMs(Math.min(Math.max(duration_s, SHORTEST_S), LONGEST_S)) });

// Phase k ends at a time. The next one gives or takes what that needs; with `rest`, all that follows moves along.
export function ending(body, k, t_s, rest) {
  const start_s = k > 0 ? endsOf(body)[k - 1] : 0,
    next = body.phases[k + 1];
  if (rest || !next) return lasting(body, k, t_s - start_s);
  const both_s = body.phases[k].duration_s + next.duration_s;
  const low_s = Math.max(SHORTEST_S, both_s - LONGEST_S),
    high_s = Math.min(both_s - SHORTEST_S, LONGEST_S);
  if (low_s > high_s) return body;
  const first = lasting(body, k, Math.min(Math.max(t_s - start_s, low_s), high_s));
  return lasting(first, k + 1, both_s - first.phases[k].duration_s);
}

export function split(body, k) {
  const phase = body.phases[k],
    half_s = toMs(phase.duration_s / 2);
  if (half_s < SHORTEST_S)
    throw new Error(`Phase ${k} is too short to be split: both halves must last ${SHORTEST_S} s.`);
  const halves = [half_s, toMs(phase.duration_s - half_s)].map((duration_s) => ({ ...phase, duration_s }));
  return withPhases(body, body.phases.toSpliced(k, 1, ...halves));
}

// One more phase after phase k, with its contacts.
export const added = (body, k) =>
  withPhases(body, body.phases.toSpliced(k + 1, 0, { ...body.phases[k], duration_s: ADDED_S }));

export function removed(body, k) {
  if (body.phases.length === 1) throw new Error("A scenario has at least one phase.");
  return withPhases(body, body.phases.toSpliced(k, 1));
}

// `contact` in phase k in place of what its effector does there; null takes the effector away.
export function touching(body, k, effector, contact) {
  const here = body.phases[k].contacts,
    at = here.findIndex((one) => one.effector === effector);
  const contacts = at < 0 ? [...here] : here.toSpliced(at, 1);
  if (contact) contacts.splice(at < 0 ? contacts.length : at, 0, contact);
  return replaced(body, k, { ...body.phases[k], contacts });
}

// Where an effector touches in phase k, and where it did last and will next, each with its phase; null where it does not.
export function around(body, k, effector) {
  const find = (numbers) => {
    const at = numbers.find((i) => contactIn(body, i, effector));
    return at === undefined ? null : { phase: at, contact: contactIn(body, at, effector) };
  };
  const here = contactIn(body, k, effector);
  const before = find(Array.from({ length: k }, (_, i) => k - 1 - i));
  const after = find(Array.from({ length: body.phases.length - k - 1 }, (_, i) => k + 1 + i));
  const chosen = !here
    ? "away"
    : sameContact(here, before?.contact)
      ? "before"
      : sameContact(here, after?.contact)
        ? "after"
        : "own";
  return { here, before, after: sameContact(before?.contact, after?.contact) ? null : after, chosen };
}

// A first guess of a place that an effector has not been put to before: on the way, beside the other foot, or on a rail.
export function freshPlace(body, k, effector) {
  const { before, after } = around(body, k, effector),
    near = before?.contact ?? after?.contact;
  const put = (position, like) => ({
    effector,
    position_m: position.map((v) => Math.round(v * 1e6) / 1e6),
    orientation_wxyz: like?.orientation_wxyz ?? [1, 0, 0, 0],
  });
  const left = effector.startsWith("left") ? 1 : -1,
    hand = effector.includes("hand");
  const feet = body.phases[k].contacts
    .filter((contact) => contact.effector.includes("foot"))
    .map((contact) => contact.position_m);
  const middle = [0, 1, 2].map((i) => feet.reduce((sum, foot) => sum + foot[i], 0) / Math.max(feet.length, 1));
  if (hand) {
    const rail = body.terrain.find((surface) => surface.kind === "rail");
    if (rail) return put(...onRail(rail, near?.position_m ?? middle));
    return put(near?.position_m ?? [middle[0] + HAND_M[0], middle[1] + left * HAND_M[1], middle[2] + HAND_M[2]], near);
  }
  let place = [middle[0], middle[1] + left * APART_M, middle[2]];
  if (before && after) place = [0, 1, 2].map((i) => (before.contact.position_m[i] + after.contact.position_m[i]) / 2);
  else if (near) place = [near.position_m[0] + (before ? STRIDE_M : -STRIDE_M), near.position_m[1], near.position_m[2]];
  return put([place[0], place[1], groundBelow(body.terrain, place)], near ?? body.phases[k].contacts[0]);
}

// The place on top of a rail that is nearest to a point, and the turn that has z along the rail's normal.
function onRail(rail, point) {
  const along = rail.to_m.map((v, i) => v - rail.from_m[i]);
  const square = along.reduce((sum, v) => sum + v * v, 0);
  const part = along.reduce((sum, v, i) => sum + v * (point[i] - rail.from_m[i]), 0) / square;
  const at = Math.min(Math.max(part, 0), 1);
  const normal = [0, 1, 2].map((i) => (i === 2 ? 1 : 0) - (along[2] * along[i]) / square);
  const norm = Math.hypot(...normal);
  return [
    rail.from_m.map((v, i) => v + at * along[i] + (rail.radius_m * normal[i]) / norm),
    { orientation_wxyz: towards(normal, norm) },
  ];
}

// The highest upper face of a level box at a place.
function groundBelow(terrain, place) {
  const [x, y, z] = place;
  const below = terrain
    .filter((box) => box.kind === "box" && !box.orientation_wxyz)
    .filter((box) => {
      const c = Math.cos(box.yaw_rad ?? 0),
        s = Math.sin(box.yaw_rad ?? 0);
      const [u, v] = [x - box.center_m[0], y - box.center_m[1]];
      return Math.abs(c * u + s * v) <= box.size_m[0] / 2 && Math.abs(c * v - s * u) <= box.size_m[1] / 2;
    });
  return below.length ? Math.max(...below.map((box) => box.center_m[2] + box.size_m[2] / 2)) : z;
}
