import assert from "node:assert/strict";
import test from "node:test";

import { labelOf } from "../../../frontend/stridelab_web/static/js/shared/field_labels.js";

test("a coordinate has its axis and unit", () => {
  assert.equal(labelOf(["effectors", "left_foot", "position_m", 0]), "left foot · position x [m]");
  assert.equal(labelOf(["effectors", "left_foot", "contact_half_size_m", 1]), "left foot · contact half size y [m]");
});

test("names of joints stay as they are", () => {
  assert.equal(labelOf(["limits", "torque_nm", "leg_left_1_joint"]), "limits · torque · leg_left_1_joint [N m]");
  assert.equal(labelOf(["limits", "velocity_rad_s", "arm_.*"]), "limits · velocity · arm_.* [rad/s]");
});

test("what has no unit has none", () => {
  assert.equal(labelOf(["reference", "weight"]), "reference · weight");
});

test("the components of a quaternion are w, x, y, z", () => {
  assert.equal(labelOf(["effectors", "left_foot", "orientation_wxyz", 0]), "left foot · orientation w");
  assert.equal(labelOf(["effectors", "left_foot", "orientation_wxyz", 3]), "left foot · orientation z");
});
