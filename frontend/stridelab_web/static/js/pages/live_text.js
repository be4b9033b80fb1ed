// What the page of live streams says of one answer: margins with their bars, feet, and what was missing.

import { translate, translateCount } from "../shared/translate.js";

const NEAR_M = 0.02;
const LEAST_M = -0.2;
const MOST_M = 0.3;

/** @type {Record<string, string>} */
const REASONS = {
  "frame-late": translate("the frame came late"),
  overtaken: translate("the service is behind"),
  "no-contact": translate("no foot stands; on a treadmill, state the speed of the belt"),
  "feet-hidden": translate("the markers of the feet are hidden"),
  "feet-not-marked": translate("the feet are not marked"),
  "markers-hidden": translate("markers that the body model needs are hidden"),
  "pelvis-markers-missing": translate("the pelvis is hidden"),
  "knee-markers-missing": translate("a knee is hidden"),
  "ankle-markers-missing": translate("an ankle is hidden"),
  "sides-swapped": translate("markers of the right side lie on the left"),
  "size-implausible": translate("the body is not as large as a person: check the units"),
  "axis-implausible": translate("the body has not stood along the vertical axis yet: check up_axis"),
  "no-plates": translate("there are no plates"),
  "foot-beside-plates": translate("a foot stands beside the plates"),
  "plate-late": translate("a plate was not read"),
  "mass-not-stated": translate("the mass of the person is not stated"),
  "force-points-down": translate("the force points down"),
};

/** @param {string | null} code */
export const reason = (code) => (code ? (REASONS[code] ?? code.replaceAll("-", " ")) : "");

/** @param {number} margin */
const percent = (margin) => (100 * (Math.min(Math.max(margin, LEAST_M), MOST_M) - LEAST_M)) / (MOST_M - LEAST_M);

// Number, verdict and bar of one margin. Ahead of the base is no fault of a walk: the next step goes there.
/** @param {"ap" | "ml"} axis @param {any} answer */
export function describeMargin(axis, answer) {
  const margin = answer.margin_m?.[axis];
  if (margin === undefined)
    return { text: "–", state: "none", verdict: reason(answer.margin_reason), left: 0, width: 0 };
  const zero = percent(0);
  const end = percent(margin);
  const state = margin >= NEAR_M ? "inside" : margin >= 0 || axis === "ap" ? "near" : "outside";
  const beyond = axis === "ap" ? translate("ahead of the base: a step must follow") : translate("outside the base");
  const verdict = margin >= NEAR_M ? translate("inside the base") : margin >= 0 ? translate("at the edge") : beyond;
  const text = `${margin < 0 ? "−" : "+"}${(100 * Math.abs(margin)).toFixed(1)} cm`;
  return { text, state, verdict, left: Math.min(zero, end), width: Math.abs(end - zero) };
}

/** @param {{left: boolean | null, right: boolean | null}} contact */
export function standing(contact) {
  if (contact.left === null && contact.right === null) return "–";
  if (contact.left && contact.right) return translate("both feet");
  if (contact.left) return translate("left foot");
  return contact.right ? translate("right foot") : translate("none");
}

/** @param {any} answer */
export function describeMissing(answer) {
  const { frames_lost, markers_hidden, geometry, force } = answer.bridged;
  const parts = [];
  if (answer.reason) parts.push(translate("No estimate: %(reason)s.", { reason: reason(answer.reason) }));
  if (frames_lost) parts.push(translateCount("%(num)s frame lost.", "%(num)s frames lost.", frames_lost));
  if (markers_hidden.length) parts.push(translate("Hidden: %(markers)s.", { markers: markers_hidden.join(", ") }));
  if (geometry === "coasted") parts.push(translate("Carried on by force or velocity."));
  if (geometry === "substituted") parts.push(translate("Hidden landmarks are substituted."));
  parts.push(
    force ? translate("Markers only: %(reason)s.", { reason: reason(force) }) : translate("Markers and force."),
  );
  return parts.join(" ");
}
