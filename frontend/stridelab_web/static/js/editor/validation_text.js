// Sentences about the validation result of a scenario.
const LOCATION = /^phases\[(\d+)\](?:\.contacts\[(\w+)\])?/;
const MARGIN_TOLERANCE_M = 1e-4; // margins that differ by less count as equal
const HEIGHT_TOLERANCE_M = 5e-4; // a contact within this distance of its surface is on it

export const BODY_UNFINISHED = "body-unfinished";
const REACHABLE = "Every contact is on its surface and within reach";

// Summary of the validation by learned reachability (`check`) and by whole-body postures (`whole`, null while its result is
// missing; `failure` is the reason if there is none). `kind` is "invalid", "asked" (whole body pending) or "valid".
/** @param {ScenarioCheck} check @param {ScenarioCheck | null} whole @param {string} failure */
export function summarizeValidation(check, whole, failure = "") {
  if (check.errors.length) return { errors: check.errors, kind: "invalid", text: errorSentence(check.errors[0]) };
  if (failure)
    return {
      errors: [],
      kind: "asked",
      text: `${REACHABLE}; whether the body can stand there is not known: ${failure}`,
    };
  if (!whole) return { errors: [], kind: "asked", text: `${REACHABLE}; the whole body is being checked…` };
  const errors = whole.phases.filter(({ body }) => body === "unreachable").map((one) => unreachableError(whole, one));
  if (errors.length) return { errors, kind: "invalid", text: errorSentence(errors[0]) };
  const isUnfinished = whole.warnings.some(({ code }) => code === BODY_UNFINISHED);
  if (isUnfinished || whole.phases.some(({ body }) => body === "not-asked"))
    return { errors: [], kind: "asked", text: `${REACHABLE}; ${progressText(whole)}` };
  const remark = whole.warnings[0]?.message ?? "";
  return {
    errors: [],
    kind: "valid",
    text: `Valid: every contact is on its surface, and the body can take the stance of every phase and move on. ${capitalize(remark)}`.trim(),
  };
}

// What of an unfinished whole-body check has been done; the page repeats it by itself.
/** @param {ScenarioCheck} whole */
function progressText({ phases }) {
  const checked = phases.filter(({ body }) => body !== "not-asked").length;
  if (checked === phases.length) return "the body can take every stance, and its motion between them is being checked…";
  return `the body can take the stances of ${checked} of ${phases.length} phases, the others are being checked…`;
}

/** @param {string} sentence */
const capitalize = (sentence) => sentence.charAt(0).toUpperCase() + sentence.slice(1);

// The error that names the contact, or one that names the phase where the service lists no error for it.
/** @type {(whole: ScenarioCheck, phase: ScenarioCheck["phases"][number]) => PlacedError} */
const unreachableError = (whole, { phase, reason }) =>
  whole.errors.find((error) => error.message === reason && errorLocation(error)?.phase === phase) ?? {
    where: `phases[${phase}]`,
    message: reason ?? "", // an unreachable phase has one
  };

/** @param {number} length_m */
const centimetres = (length_m) => `${(100 * Math.abs(length_m)).toFixed(1)} cm`;
/** @param {string} effector */
export const effectorLabel = (effector) => effector.replaceAll("_", " ");

// The phase and the effector that an error names; null for an error about the whole scenario.
/** @param {{ where: string }} error */
export function errorLocation(error) {
  const match = LOCATION.exec(error.where);
  return match && { phase: Number(match[1]), effector: match[2] ?? null };
}

/** @param {PlacedError} error */
export function errorSentence(error) {
  const place = errorLocation(error);
  const where = place
    ? `Phase ${place.phase}${place.effector ? `, ${effectorLabel(place.effector)}` : ""}`
    : error.where;
  return `${where}: ${error.message}`;
}

// Each phase of a scenario with its kind ("rest": static equilibrium, "motion": none, "unknown" or "invalid"), its support
// region, and the CoM position with the largest margin.
/** @param {ScenarioCheck} check @param {Scenario} scenario @returns {PhaseState[]} */
export function phaseStates(check, scenario) {
  const invalid = new Set(check.errors.flatMap((error) => affectedPhases(errorLocation(error), check, scenario)));
  return scenario.phases.map((phase, k) => {
    const { margin_m, com_m } = check.support[k];
    const region_m = check.support_region_m[k];
    const equilibrium =
      margin_m === null ? (region_m.length ? "unknown" : "motion") : margin_m >= 0 ? "rest" : "motion";
    return { ...phase, kind: invalid.has(k) ? "invalid" : equilibrium, margin_m, com_m, region_m };
  });
}

// The phases that an error affects. The service reports a misplaced contact once, in its first phase, and an unreachable
// one in each phase.
/** @param {ReturnType<typeof errorLocation>} place @param {ScenarioCheck} check @param {Scenario} scenario */
function affectedPhases(place, check, scenario) {
  if (!place) return [];
  const affected = [place.phase];
  /** @param {number} k */
  const at = (k) => JSON.stringify(scenario.phases[k]?.contacts.find((contact) => contact.effector === place.effector));
  const margin = check.margins.find((one) => one.phase === place.phase && one.effector === place.effector);
  if (!margin || (margin.reach_m !== null && margin.reach_m < 0)) return affected;
  for (let k = place.phase + 1; at(k) === at(place.phase); k += 1) affected.push(k);
  return affected;
}

/** @param {PhaseState} phase @param {number} k */
export function phaseSentence(phase, k) {
  const effectors = phase.contacts.map((contact) => effectorLabel(contact.effector)).join(", ") || "nothing touches";
  return `Phase ${k}: ${effectors}. ${equilibriumSentence(phase)}`;
}

/** @param {PhaseState} phase */
function equilibriumSentence({ kind, margin_m, region_m }) {
  const invalid = kind === "invalid" ? "Not valid. " : "";
  if (margin_m === null && !region_m.length) return `${invalid}Only passed in motion: nowhere could the CoM rest.`;
  if (margin_m === null) return `${invalid}How much the CoM could have to spare is not known.`;
  if (margin_m >= 0) return `${invalid}The CoM can rest here with ${centimetres(margin_m)} to spare.`;
  return `${invalid}Only passed in motion: to rest, the CoM would have to be ${centimetres(margin_m)} farther than it reaches.`;
}

// Of the phases with these numbers, the first one with the smallest margin; an invalid phase comes before all others.
/** @param {PhaseState[]} phases @param {number[]} numbers */
export function worstPhase(phases, numbers) {
  /** @param {PhaseState} phase */
  const margin = ({ kind, margin_m, region_m }) => {
    if (kind === "invalid") return -Infinity;
    if (margin_m === null) return region_m.length ? Infinity : -Number.MAX_VALUE;
    return Math.round(margin_m / MARGIN_TOLERANCE_M);
  };
  return numbers.reduce((worst, k) => (margin(phases[k]) < margin(phases[worst]) ? k : worst), numbers[0]);
}

// The margins of a touch to its limits, as [name, sentence] pairs.
/** @param {ScenarioCheck} check @param {Pick<Touch, "effector" | "phases">} touch */
export function contactMargins(check, touch) {
  const [first, last] = touch.phases;
  const margins = check.margins.filter(
    (margin) => margin.effector === touch.effector && margin.phase >= first && margin.phase <= last,
  );
  if (!margins.length) return [];
  const { surface, edge_m, height_m } = margins[0];
  const reached = margins.flatMap(({ phase, reach_m }) => (reach_m === null ? [] : [{ phase, reach_m }]));
  const least = reached.reduce((worst, margin) => (margin.reach_m < worst.reach_m ? margin : worst), reached[0]);
  const lines = [];
  if (edge_m !== null)
    lines.push([
      "Edge",
      edge_m >= 0
        ? `${centimetres(edge_m)} inside the edge of ${surface}`
        : `${centimetres(edge_m)} beyond the edge of ${surface}`,
    ]);
  if (height_m !== null)
    lines.push([
      "Height",
      Math.abs(height_m) < HEIGHT_TOLERANCE_M
        ? "on the surface"
        : `${centimetres(height_m)} ${height_m > 0 ? "above" : "inside"} the surface`,
    ]);
  if (least) {
    const where = first === last ? "" : `, least in phase ${least.phase}`;
    lines.push([
      "Reach",
      least.reach_m >= 0
        ? `${centimetres(least.reach_m)} to spare${where}`
        : `${centimetres(least.reach_m)} too short for each contact of phase ${least.phase}`,
    ]);
  }
  return lines;
}
