import assert from "node:assert/strict";
import test from "node:test";
import { cubicHermiteWeights } from "../../../frontend/stridelab_web/static/js/viewer/interpolation.js";
import { assertNear } from "./near.mjs";

const EVEN = [0, 1, 2, 3],
  UNEVEN = [0, 0.02, 0.05, 0.06, 0.1];

function interpolated(f, time_s, low, fraction) {
  const weights = cubicHermiteWeights(time_s, low, fraction);
  return weights.reduce((sum, weight, i) => (weight === 0 ? sum : sum + weight * f(time_s[low - 1 + i])), 0);
}

test("weights of equally spaced frames are those of the Catmull-Rom spline", () => {
  assertNear(cubicHermiteWeights(EVEN, 1, 0.5), [-1 / 16, 9 / 16, 9 / 16, -1 / 16]);
  assertNear(cubicHermiteWeights(EVEN, 1, 0.25), [-9 / 128, 111 / 128, 29 / 128, -3 / 128]);
});

test("the frames themselves are met", () => {
  assertNear(cubicHermiteWeights(UNEVEN, 1, 0), [0, 1, 0, 0]);
  assertNear(cubicHermiteWeights(UNEVEN, 1, 1), [0, 0, 1, 0]);
});

test("parabolas are exact between unequally spaced frames", () => {
  const parabola = (t) => 3 - 2 * t + 70 * t * t;
  for (const [low, fraction] of [
    [1, 0.3],
    [1, 0.9],
    [2, 0.5],
  ]) {
    const t = UNEVEN[low] + fraction * (UNEVEN[low + 1] - UNEVEN[low]);
    assertNear([interpolated(parabola, UNEVEN, low, fraction)], [parabola(t)]);
  }
});

test("straight lines are exact in the first and last interval, which lack a neighbour", () => {
  const line = (t) => 4 + 11 * t;
  for (const low of [0, 3]) {
    const t = UNEVEN[low] + 0.4 * (UNEVEN[low + 1] - UNEVEN[low]);
    assertNear([interpolated(line, UNEVEN, low, 0.4)], [line(t)]);
  }
  assert.equal(cubicHermiteWeights(UNEVEN, 0, 0.4)[0], 0);
  assert.equal(cubicHermiteWeights(UNEVEN, 3, 0.4)[3], 0);
});
