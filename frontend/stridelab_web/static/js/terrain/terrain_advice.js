// What to do about the file of a terrain that was refused, and about places that cannot be crossed.
import { translate, translateServed } from "../shared/translate.js";

/** @type {Record<string, number>} */
const METRES_PER = { m: 1, cm: 0.01, mm: 0.001 };
const WIDTH_M = [0.5, 60]; // of a terrain whose unit is taken for the right one
const WIDE = /It is (\d[\d.]*(?:e[+-]?\d+)?) m wide/;

// The units in which a refused file would be as wide as terrains are, and that width, the widest first.
/** @param {string} detail of the refusal @param {string} unit in which the file was read @returns {{ unit: string, width_m: number }[]} */
export function unitsThatFit(detail, unit) {
  const match = WIDE.exec(detail);
  if (!match) return [];
  const width = Number(match[1]) / METRES_PER[unit];
  return Object.entries(METRES_PER)
    .map(([other, metres]) => ({ unit: other, width_m: width * metres }))
    .filter(({ unit: other, width_m }) => other !== unit && width_m >= WIDTH_M[0] && width_m <= WIDTH_M[1]);
}

// The other axis that may point up in a file; without a choice, its format decides.
/** @param {string} name of the file @param {string} up the choice, or nothing */
export function otherUpAxis(name, up) {
  const used = up || (name.toLowerCase().endsWith(".glb") ? "+y" : "+z");
  return used === "+y" ? "+z" : "+y";
}

// Why a file was refused and what to do about it.
/** @param {string} code @param {string} detail the sentence of the service */
export function refusalText(code, detail) {
  if (code === "parser-timed-out" || code === "parser-out-of-memory")
    return translate(
      "The terrain is too large to be read here: cut out the part that is crossed, or reduce its triangles.",
    );
  const why = translateServed(detail);
  if (code !== "terrain-without-surfaces") return why;
  const advice = translate("Try another unit, or the other axis that points up.");
  return `${why} ${advice}`;
}

// Why a way cannot be planned and what to do, by what the service refuses; null for any other refusal.
/** @param {ApiProblem} problem @returns {string | null} */
export function crossingAdvice(problem) {
  if (problem.code === "crossing-too-short")
    return translate("Start and goal are too near to each other: at least %(least)s m are needed.", { least: 0.3 });
  if (problem.code !== "terrain-without-foothold") return null;
  const place = problem.errors?.[0]?.where ?? "";
  if (place.startsWith("start"))
    return translate("A foot at the start has no surface below it: move the start away from the edge.");
  return translate("A foot at the goal has no surface below it: move the goal away from the edge.");
}
