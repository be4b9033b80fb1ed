import assert from "node:assert/strict";
import test from "node:test";
import {
  contactChoices,
  contactInPhase,
  duplicatePhase,
  movePhaseEnd,
  phaseEndTimes,
  removePhase,
  setContact,
  setDuration,
  splitPhase,
  suggestContact,
} from "../../../frontend/stridelab_web/static/js/editor/phase_edits.js";
import { assertNear } from "./near.mjs";
import { AHEAD, contact, durations, LEFT, phase, RIGHT, walk } from "./scenario.mjs";

test("end times are the sums of durations", () => {
  assert.deepEqual(phaseEndTimes(walk()), [1, 1.5, 3.5]);
});

test("durations are limited and rounded to milliseconds", () => {
  assert.deepEqual(durations(setDuration(walk(), 1, 0.75049)), [1, 0.75, 2]);
  assert.deepEqual(durations(setDuration(walk(), 1, 0)), [1, 0.05, 2]);
  assert.deepEqual(durations(setDuration(walk(), 1, 1e3)), [1, 60, 2]);
});

test("an edit leaves the scenario unchanged and copies the other phases", () => {
  const before = walk(),
    after = setDuration(before, 0, 2);
  assert.deepEqual(before, walk());
  assert.equal(after.phases[1], before.phases[1]);
});

test("a moved end takes its time from the next phase", () => {
  assert.deepEqual(durations(movePhaseEnd(walk(), 0, 1.2, false)), [1.2, 0.3, 2]);
  assert.deepEqual(durations(movePhaseEnd(walk(), 1, 1.1, false)), [1, 0.1, 2.4]);
  assert.deepEqual(durations(movePhaseEnd(walk(), 0, 9, false)), [1.45, 0.05, 2]);
  assert.deepEqual(durations(movePhaseEnd(walk(), 1, 0, false)), [1, 0.05, 2.45]);
});

test("a moved end shifts later phases, or is that of the last phase", () => {
  assert.deepEqual(durations(movePhaseEnd(walk(), 0, 1.2, true)), [1.2, 0.5, 2]);
  assert.deepEqual(durations(movePhaseEnd(walk(), 2, 3, false)), [1, 0.5, 1.5]);
});

test("phases are split, duplicated and removed", () => {
  assert.deepEqual(durations(splitPhase(walk(), 0)), [0.5, 0.5, 0.5, 2]);
  assert.deepEqual(splitPhase(walk(), 0).phases[1].contacts, [LEFT, RIGHT]);
  assert.throws(() => splitPhase(setDuration(walk(), 0, 0.08), 0), /too short to be split/);
  assert.deepEqual(duplicatePhase(walk(), 1).phases[2], phase(0.5, LEFT));
  assert.deepEqual(durations(duplicatePhase(walk(), 0)), [1, 0.5, 0.5, 2]);
  assert.deepEqual(durations(removePhase(walk(), 1)), [1, 2]);
  assert.throws(() => removePhase({ ...walk(), phases: [phase(1)] }, 0), /at least one phase/);
});

test("contacts are replaced in place, added and removed", () => {
  const moved = contact("left_foot", 0.1, 0.1);
  assert.deepEqual(setContact(walk(), 0, "left_foot", moved).phases[0].contacts, [moved, RIGHT]);
  assert.deepEqual(setContact(walk(), 1, "right_foot", AHEAD).phases[1].contacts, [LEFT, AHEAD]);
  assert.deepEqual(setContact(walk(), 0, "left_foot", null).phases[0].contacts, [RIGHT]);
  assert.equal(contactInPhase(walk(), 1, "right_foot"), null);
  assert.equal(contactInPhase(walk(), 7, "right_foot"), null);
});

test("the choices of an effector are its nearest earlier and later contacts", () => {
  const { here, before, after, chosen } = contactChoices(walk(), 1, "right_foot");
  assert.deepEqual([here, chosen], [null, "away"]);
  assert.deepEqual(before, { phase: 0, contact: RIGHT });
  assert.deepEqual(after, { phase: 2, contact: AHEAD });
  assert.equal(contactChoices(walk(), 1, "left_foot").chosen, "before");
  assert.equal(contactChoices(walk(), 1, "left_foot").after, null); // the same as before
  assert.equal(contactChoices(walk(), 0, "left_foot").chosen, "after");
  assert.equal(contactChoices(walk(), 2, "right_foot").chosen, "own");
});

test("a foot is suggested between its neighbours, or a stride ahead, on the ground", () => {
  assertNear(suggestContact(walk(), 1, "right_foot").position_m, [0.2, -0.1, 0]);
  const longer = duplicatePhase(walk(), 2);
  longer.phases[3] = phase(0.5, LEFT);
  assertNear(suggestContact(longer, 3, "right_foot").position_m, [0.6, -0.1, 0]);
});

test("a foot is suggested on the highest box below it, whatever its yaw", () => {
  const onPlank = (/** @type {number[]} */ center_m) => {
    const scenario = walk();
    scenario.terrain.push({ kind: "box", name: "plank", center_m, size_m: [2, 0.2, 0.2], yaw_rad: Math.PI / 4 });
    return suggestContact(scenario, 1, "right_foot").position_m; // at x = 0.2, y = -0.1
  };
  assertNear(onPlank([-0.3, -0.6, 0.1]), [0.2, -0.1, 0.2]); // the plank points to it
  assertNear(onPlank([-0.3, 0.4, 0.1]), [0.2, -0.1, 0]); // the plank lies across
  assertNear(onPlank([-0.7, -1, 0.1]), [0.2, -0.1, 0]); // the plank ends before it
});

test("a hand is suggested on top of the nearest point of a rail, along its normal", () => {
  const scenario = walk();
  scenario.terrain.push({ kind: "rail", from_m: [-1, 0.5, 1], to_m: [1, 0.5, 1], radius_m: 0.02 });
  const { position_m, orientation_wxyz } = suggestContact(scenario, 0, "left_hand");
  assertNear(position_m, [0, 0.5, 1.02]);
  assertNear(orientation_wxyz, [1, 0, 0, 0]);
  assertNear(suggestContact(walk(), 0, "right_hand").position_m, [0.3, -0.4, 0.9]);
});
