import assert from "node:assert/strict";
import test from "node:test";
import {
  contactMargins,
  effectorLabel,
  errorLocation,
  errorSentence,
  phaseSentence,
  phaseStates,
  summarizeValidation,
  worstPhase,
} from "../../../frontend/stridelab_web/static/js/editor/validation_text.js";
import { walk } from "./scenario.mjs";

const SQUARE = [
  [0, 0],
  [1, 0],
  [1, 1],
];
/** @returns {any} */
const check = (errors = [], margins = []) => ({
  errors,
  margins,
  support: [
    { margin_m: 0.04, com_m: [0, 0, 0.8] },
    { margin_m: -0.02, com_m: null },
    { margin_m: null, com_m: null },
  ],
  support_region_m: [SQUARE, SQUARE, []],
});
/** @returns {any} */
const margin = (phase, reach_m, extra = {}) => ({
  phase,
  effector: "left_foot",
  surface: "floor",
  edge_m: 0.031,
  height_m: 0,
  reach_m,
  ...extra,
});
/** @returns {any} */
const wholeBody = (...bodies) => ({
  errors: [],
  warnings: [],
  phases: bodies.map((body, k) => ({ phase: k, body, reason: `no posture ${k}` })),
});

test("an error names its phase and effector", () => {
  assert.deepEqual(errorLocation({ where: "phases[12].contacts[left_foot].position_m" }), {
    phase: 12,
    effector: "left_foot",
  });
  assert.deepEqual(errorLocation({ where: "phases[0].duration_s" }), { phase: 0, effector: null });
  assert.equal(errorLocation({ where: "friction" }), null);
  assert.equal(
    errorSentence({ where: "phases[2].contacts[right_hand]", message: "off the rail" }),
    "Phase 2, right hand: off the rail",
  );
  assert.equal(errorSentence({ where: "friction", message: "is negative" }), "friction: is negative");
  assert.equal(effectorLabel("left_rear_foot"), "left rear foot");
});

test("the summary takes errors first, then whole-body postures", () => {
  const error = { where: "phases[1]", message: "too short" };
  assert.deepEqual(summarizeValidation(check([error]), wholeBody("reachable")), {
    errors: [error],
    kind: "invalid",
    text: "Phase 1: too short",
  });
  assert.equal(summarizeValidation(check(), null).kind, "asked");
  assert.match(summarizeValidation(check(), null, "No solver.").text, /not known: No solver\.$/);
  assert.equal(summarizeValidation(check(), wholeBody("reachable", "reachable")).kind, "valid");
  assert.equal(summarizeValidation(check(), wholeBody("reachable", "not-asked")).kind, "asked");
  const unfinished = { ...wholeBody("reachable"), warnings: [{ code: "body-unfinished", message: "repeat" }] };
  assert.equal(summarizeValidation(check(), unfinished).kind, "asked");
  const strained = { ...wholeBody("reachable"), warnings: [{ code: "body-strained", message: "the body strains" }] };
  assert.match(summarizeValidation(check(), strained).text, /move on\. The body strains$/);
  assert.equal(summarizeValidation(check(), wholeBody("reachable", "unreachable")).text, "Phase 1: no posture 1");
});

test("an unfinished check says how far it is, not what to do", () => {
  const unfinished = (...bodies) => ({
    ...wholeBody(...bodies),
    warnings: [{ code: "body-unfinished", message: "the body was not checked in 1 of 2 phases; repeat the check" }],
  });
  const text = (...bodies) => summarizeValidation(check(), unfinished(...bodies)).text;
  assert.match(
    text("reachable", "not-asked"),
    /; the body can take the stances of 1 of 2 phases, the others are being/,
  );
  assert.match(
    text("reachable", "reachable"),
    /; the body can take every stance, and its motion between them is being/,
  );
});

test("an unreachable stance has the error that names its contact", () => {
  const error = { where: "phases[1].contacts[left_foot]", message: "no posture 1" };
  assert.deepEqual(summarizeValidation(check(), { ...wholeBody("reachable", "unreachable"), errors: [error] }).errors, [
    error,
  ]);
});

test("phases are at rest, in motion, unknown or invalid", () => {
  assert.deepEqual(
    phaseStates(check(), walk()).map((state) => state.kind),
    ["rest", "motion", "motion"],
  );
  const unknown = { ...check(), support_region_m: [SQUARE, SQUARE, SQUARE] };
  assert.equal(phaseStates(unknown, walk())[2].kind, "unknown");
});

test("a misplaced contact is invalid in all its phases, an unreachable one in the phase of the error", () => {
  const error = { where: "phases[0].contacts[left_foot]", message: "off its surface" };
  const kinds = (reach_m) => phaseStates(check([error], [margin(0, reach_m)]), walk()).map((state) => state.kind);
  assert.deepEqual(kinds(0.1), ["invalid", "invalid", "invalid"]);
  assert.deepEqual(kinds(-0.1), ["invalid", "motion", "motion"]);
});

test("a phase is described by its contacts and its equilibrium", () => {
  const states = phaseStates(check(), walk());
  assert.equal(
    phaseSentence(states[0], 0),
    "Phase 0: left foot, right foot. The CoM can rest here with 4.0 cm to spare.",
  );
  assert.match(phaseSentence(states[1], 1), /would have to be 2\.0 cm farther than it reaches\.$/);
  assert.match(phaseSentence(states[2], 2), /nowhere could the CoM rest\.$/);
});

test("the worst phase is an invalid one, else the one with the smallest margin, the first of equals", () => {
  /** @returns {any[]} */
  const states = (...margins) => margins.map((margin_m) => ({ kind: "rest", margin_m, region_m: SQUARE }));
  assert.equal(worstPhase(states(0.03, 0.01, 0.02), [0, 1, 2]), 1);
  assert.equal(worstPhase(states(0.03, 0.01, 0.02), [0, 2]), 2);
  assert.equal(worstPhase(states(0.02, 0.02 - 1e-6), [0, 1]), 0);
  const mixed = [...states(-0.5), { kind: "invalid", margin_m: 0.1, region_m: SQUARE }];
  assert.equal(worstPhase(mixed, [0, 1]), 1);
});

test("the margins of a touch are those of its phases", () => {
  /** @type {any} */
  const touch = { effector: "left_foot", phases: [0, 2] };
  assert.deepEqual(contactMargins(check([], [margin(0, 0.2), margin(1, 0.05), margin(3, 0.01)]), touch), [
    ["Edge", "3.1 cm inside the edge of floor"],
    ["Height", "on the surface"],
    ["Reach", "5.0 cm to spare, least in phase 1"],
  ]);
  assert.deepEqual(
    contactMargins(check([], [margin(1, -0.04, { edge_m: -0.01, height_m: 0.02 })]), { ...touch, phases: [1, 1] }),
    [
      ["Edge", "1.0 cm beyond the edge of floor"],
      ["Height", "2.0 cm above the surface"],
      ["Reach", "4.0 cm too short for each contact of phase 1"],
    ],
  );
  assert.deepEqual(contactMargins(check(), touch), []);
});
