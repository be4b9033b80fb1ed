import assert from "node:assert/strict";
import test from "node:test";
import {
  rotateAboutZ,
  rotationFromZ,
  yawDegrees,
} from "../../../frontend/stridelab_web/static/js/viewer/quaternions.js";
import { assertNear } from "./near.mjs";

const S = Math.SQRT1_2;

// v rotated by a unit quaternion, by the rotation matrix of textbooks.
/** @type {(q: number[], v: number[]) => number[]} */
const rotated = ([w, x, y, z], [a, b, c]) => [
  (1 - 2 * (y * y + z * z)) * a + 2 * (x * y - w * z) * b + 2 * (x * z + w * y) * c,
  2 * (x * y + w * z) * a + (1 - 2 * (x * x + z * z)) * b + 2 * (y * z - w * x) * c,
  2 * (x * z - w * y) * a + 2 * (y * z + w * x) * b + (1 - 2 * (x * x + y * y)) * c,
];

test("rotations of the z axis to the axes of the world", () => {
  assertNear(rotationFromZ([0, 0, 5], 5), [1, 0, 0, 0]);
  assertNear(rotationFromZ([2, 0, 0], 2), [S, 0, S, 0]); // 90 degrees about y
  assertNear(rotationFromZ([0, 3, 0], 3), [S, -S, 0, 0]); // -90 degrees about x
  assertNear(rotated(rotationFromZ([0, 0, -1], 1), [0, 0, 1]), [0, 0, -1]);
});

test("the z axis is rotated to any direction, without twist about it", () => {
  for (const direction of [
    [1, 2, 3],
    [-4, 0.1, 0.2],
    [0.3, -0.4, -0.5],
    [1e-2, 0, -1],
  ]) {
    const norm = Math.hypot(...direction),
      q = rotationFromZ(direction, norm);
    assertNear([Math.hypot(...q)], [1], 1e-9);
    assertNear(
      rotated(q, [0, 0, 1]),
      direction.map((v) => v / norm),
      1e-9,
    );
    assert.equal(q[3], 0); // the axis of the shortest rotation is horizontal
  }
});

test("yaw of rotations about the vertical axis", () => {
  assert.equal(yawDegrees([1, 0, 0, 0]), 0);
  assertNear([yawDegrees([S, 0, 0, S])], [90]);
  assertNear([yawDegrees([Math.cos(Math.PI / 12), 0, 0, -Math.sin(Math.PI / 12)])], [-30]);
  assertNear([Math.abs(yawDegrees([0, 0, 0, 1]))], [180]);
});

test("a rotation about the vertical adds to the yaw and keeps the tilt", () => {
  assertNear(rotateAboutZ([1, 0, 0, 0], Math.PI / 2), [S, 0, 0, S]);
  const tilted = [Math.cos(0.1), Math.sin(0.1), 0, 0]; // 0.2 rad about x
  const turned = rotateAboutZ(tilted, Math.PI / 6);
  assertNear([yawDegrees(turned)], [30], 1e-9);
  assertNear([rotated(turned, [0, 0, 1])[2]], [Math.cos(0.2)]);
  assertNear(rotateAboutZ(rotateAboutZ(tilted, 0.4), -0.4), tilted);
});
