// What the service's judge says of a scenario, in words.
const PLACE = /^phases\[(\d+)\](?:\.contacts\[(\w+)\])?/;
const EQUAL_M = 1e-4; // margins that differ by less are the same
const LEVEL_M = 5e-4; // closer than this to its surface, a contact is on it

export const UNFINISHED = "body-unfinished";
const REACHED = "Every contact is on its surface and within reach";

// What is said of a scenario: by the learned reach (`check`), and by the whole body, null before it has answered or where
// `trouble` says why it cannot. `kind` is "invalid", "asked" or "valid".
export function verdictOf(check, whole, trouble = "") {
  if (check.errors.length) return { errors: check.errors, kind: "invalid", text: sentenceOf(check.errors[0]) };
  if (trouble)
    return { errors: [], kind: "asked", text: `${REACHED}; whether the body can stand there is not known: ${trouble}` };
  if (!whole) return { errors: [], kind: "asked", text: `${REACHED}; the body is being asked…` };
  const errors = whole.phases.filter(({ body }) => body === "unreachable").map((one) => bodyError(whole, one));
  if (errors.length) return { errors, kind: "invalid", text: sentenceOf(errors[0]) };
  const remark = whole.warnings[0]?.message ?? "";
  if (whole.phases.some(({ body }) => body === "not-asked"))
    return { errors: [], kind: "asked", text: `${REACHED}. ${remark}`.trim() };
  return {
    errors: [],
    kind: "valid",
    text: `Valid: every contact is on its surface, and the body can take the stance of every phase. ${remark}`.trim(),
  };
}

// The error that names the contact; of more than the service lists, the phase.
const bodyError = (whole, { phase, reason }) =>
  whole.errors.find((error) => error.message === reason && placeOf(error)?.phase === phase) ?? {
    where: `phases[${phase}]`,
    message: reason,
  };

const cm = (length_m) => `${(100 * Math.abs(length_m)).toFixed(1)} cm`;
export const named = (effector) => effector.replaceAll("_", " ");

// The phase and the effector that an error names; null where it is about the whole scenario.
export function placeOf(error) {
  const found = PLACE.exec(error.where);
  return found && { phase: Number(found[1]), effector: found[2] ?? null };
}

export function sentenceOf(error) {
  const place = placeOf(error);
  const where = place ? `Phase ${place.phase}${place.effector ? `, ${named(place.effector)}` : ""}` : error.where;
  return `${where}: ${error.message}`;
}

// Of each phase of `body`: how it is held ("rest", "motion", "unknown" or "invalid"), where, and with how much to spare.
export function phasesOf(check, body) {
  const wrong = new Set(check.errors.flatMap((error) => phasesWith(placeOf(error), check, body)));
  return body.phases.map((phase, k) => {
    const { margin_m, com_m } = check.support[k];
    const region_m = check.support_region_m[k];
    const held = margin_m === null ? (region_m.length ? "unknown" : "motion") : margin_m >= 0 ? "rest" : "motion";
    return { ...phase, kind: wrong.has(k) ? "invalid" : held, margin_m, com_m, region_m };
  });
}

// The phases that an error spoils. What is wrong with a contact's own place is said once, in the first phase in which it
// is there; what is out of reach, in each phase.
function phasesWith(place, check, body) {
  if (!place) return [];
  const found = [place.phase];
  const at = (k) => JSON.stringify(body.phases[k]?.contacts.find((contact) => contact.effector === place.effector));
  const margin = check.margins.find((one) => one.phase === place.phase && one.effector === place.effector);
  if (!margin || margin.reach_m < 0) return found;
  for (let k = place.phase + 1; at(k) === at(place.phase); k += 1) found.push(k);
  return found;
}

export function sentenceOfPhase(phase, k) {
  const who = phase.contacts.map((contact) => named(contact.effector)).join(", ") || "nothing touches";
  return `Phase ${k}: ${who}. ${heldBy(phase)}`;
}

function heldBy({ kind, margin_m, region_m }) {
  const wrong = kind === "invalid" ? "Not valid. " : "";
  if (margin_m === null && !region_m.length) return `${wrong}Only passed in motion: nowhere could the CoM rest.`;
  if (margin_m === null) return `${wrong}How much the CoM could have to spare is not known.`;
  if (margin_m >= 0) return `${wrong}The CoM can rest here with ${cm(margin_m)} to spare.`;
  return `${wrong}Only passed in motion: to rest, the CoM would have to be ${cm(margin_m)} farther than it reaches.`;
}

// Of phases with these numbers, the one that is held worst, the first of equals: an invalid one before all others.
export function tightest(phases, numbers) {
  const spare = ({ kind, margin_m, region_m }) => {
    if (kind === "invalid") return -Infinity;
    if (margin_m === null) return region_m.length ? Infinity : -Number.MAX_VALUE;
    return Math.round(margin_m / EQUAL_M);
  };
  return numbers.reduce((worst, k) => (spare(phases[k]) < spare(phases[worst]) ? k : worst), numbers[0]);
}

// How far a touch is from being refused, as [what, sentence] pairs.
export function marginsOf(check, touch) {
  const [first, last] = touch.phases;
  const own = check.margins.filter(
    (margin) => margin.effector === touch.effector && margin.phase >= first && margin.phase <= last,
  );
  if (!own.length) return [];
  const { surface, edge_m, height_m } = own[0];
  const reached = own.filter((margin) => margin.reach_m !== null);
  const far = reached.reduce((worst, margin) => (margin.reach_m < worst.reach_m ? margin : worst), reached[0]);
  const lines = [];
  if (edge_m !== null)
    lines.push([
      "Edge",
      edge_m >= 0 ? `${cm(edge_m)} inside the edge of ${surface}` : `${cm(edge_m)} beyond the edge of ${surface}`,
    ]);
  if (height_m !== null)
    lines.push([
      "Height",
      Math.abs(height_m) < LEVEL_M
        ? "on the surface"
        : `${cm(height_m)} ${height_m > 0 ? "above" : "inside"} the surface`,
    ]);
  if (far) {
    const least = first === last ? "" : `, least in phase ${far.phase}`;
    lines.push([
      "Reach",
      far.reach_m >= 0
        ? `${cm(far.reach_m)} to spare${least}`
        : `${cm(far.reach_m)} too short for each contact of phase ${far.phase}`,
    ]);
  }
  return lines;
}
