// Pushes of the page of a live robot: along a drag, and in a direction as the robot faces.
import test from "node:test";
import assert from "node:assert/strict";
import { dragImpulse, directedImpulse } from "../../../frontend/stridelab_web/static/js/viewer/live_overlay.js";
import { assertNear as near } from "./near.mjs";

test("a drag pushes along itself, in proportion, up to a limit", () => {
  near(dragImpulse([0, 0.5, 0], 100), [0, 30, 0]);
  near(dragImpulse([3, 0, 4], 10), [9, 0, 12]);
  assert.deepEqual(dragImpulse([0, 0, 0], 100), [0, 0, 0]);
  assert.deepEqual(dragImpulse([NaN, 0, 0], 100), [0, 0, 0]);
});

test("directions are those of the robot, and horizontal", () => {
  const along_x = [0, 0, 1, 1, 0, 0, 0];
  near(directedImpulse("ahead", 20, along_x), [20, 0, 0]);
  near(directedImpulse("left", 20, along_x), [0, 20, 0]);
  const facing_y = [0, 0, 1, Math.SQRT1_2, 0, 0, Math.SQRT1_2];
  near(directedImpulse("ahead", 20, facing_y), [0, 20, 0]);
  near(directedImpulse("right", 20, facing_y), [20, 0, 0]);
  const leaning = [0, 0, 1, Math.cos(0.1), 0, Math.sin(0.1), 0];
  near(directedImpulse("back", 20, leaning), [-20, 0, 0]);
});
