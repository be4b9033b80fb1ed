// Pushes of the page of a live robot: along a drag, and in a direction as the robot faces.
import test from "node:test";
import assert from "node:assert/strict";
import {
  dragImpulse,
  directedImpulse,
  ribbonAlong,
  soleCorners,
} from "../../../frontend/stridelab_web/static/js/viewer/live_overlay.js";
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

test("a foothold is drawn as the rectangle of its sole, turned by its heading", () => {
  const corners = soleCorners({ position_m: [1, 2, 0.1], yaw_rad: Math.PI / 2 }, [0.1, 0.06]);
  assert.equal(corners.length, 4);
  near(corners[0], [0.94, 2.1, 0.1]);
  near(corners[2], [1.06, 1.9, 0.1]);
});

test("a ribbon has its width across the path, and lies on the ground", () => {
  const edge = ribbonAlong(
    [
      [0, 0, 0.8],
      [1, 0, 0.8],
      [2, 0, 0.8],
    ],
    0.1,
    0,
  ); // prettier-ignore
  assert.equal(edge.length, 6);
  near(edge[0], [0, 0.05, 0]);
  near(edge[5], [0, -0.05, 0]);
  assert.ok(
    ribbonAlong(
      [
        [0, 0, 0],
        [0, 0, 0],
      ],
      0.1,
      0,
    )
      .flat()
      .every(Number.isFinite),
  ); // prettier-ignore
});
