// Commands of the stick and of the arrow keys of a live robot.
import test from "node:test";
import assert from "node:assert/strict";
import { LIMITS, placeOfKeys, stickCommand } from "../../../frontend/stridelab_web/static/js/viewer/live_steering.js";

test("the stick commands up to the limits, turning or sideways", () => {
  assert.deepEqual(stickCommand(0, 1, false), { ahead_m_s: LIMITS.ahead_m_s, left_m_s: 0, turn_rad_s: 0 });
  assert.deepEqual(stickCommand(1, 0, false), { ahead_m_s: 0, left_m_s: 0, turn_rad_s: -LIMITS.turn_rad_s });
  assert.deepEqual(stickCommand(-1, 0, true), { ahead_m_s: 0, left_m_s: LIMITS.left_m_s, turn_rad_s: 0 });
  const corner = stickCommand(-1, 1, false);
  assert.ok(Math.abs(corner.ahead_m_s - LIMITS.ahead_m_s * Math.SQRT1_2) < 1e-12);
  assert.ok(Math.abs(corner.turn_rad_s - LIMITS.turn_rad_s * Math.SQRT1_2) < 1e-12);
  assert.deepEqual(stickCommand(0, 0, false), { ahead_m_s: 0, left_m_s: 0, turn_rad_s: 0 });
});

test("opposite keys cancel, others add", () => {
  assert.deepEqual(placeOfKeys(["ArrowUp", "ArrowLeft"]), [-1, 1]);
  assert.deepEqual(placeOfKeys(["ArrowUp", "ArrowDown"]), [0, 0]);
  assert.deepEqual(placeOfKeys(["x"]), [0, 0]);
});
