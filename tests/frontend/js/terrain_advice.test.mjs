import assert from "node:assert/strict";
import test from "node:test";
import {
  crossingAdvice,
  otherUpAxis,
  refusalText,
  unitsThatFit,
} from "../../../frontend/stridelab_web/static/js/terrain/terrain_advice.js";

const WIDE = (/** @type {string} */ width) =>
  `The mesh of the terrain cannot be used. It is ${width} m wide; a terrain has 0.2 to 100 m. State its unit.`;

test("the units are offered in which the width is that of a terrain", () => {
  assert.deepEqual(unitsThatFit(WIDE("4e+03"), "m"), [
    { unit: "cm", width_m: 40 },
    { unit: "mm", width_m: 4 },
  ]);
  assert.deepEqual(unitsThatFit(WIDE("0.004"), "mm"), [{ unit: "m", width_m: 4 }]);
  assert.deepEqual(unitsThatFit(WIDE("2e+09"), "m"), []);
});

test("no unit is offered for another refusal", () => {
  assert.deepEqual(unitsThatFit("The mesh of the terrain cannot be used. It is damaged.", "m"), []);
});

test("what can be done is said where the service does not say it", () => {
  assert.match(refusalText("terrain-without-surfaces", "It has no surface."), /^It has no surface\. .*another unit/);
  for (const code of ["parser-timed-out", "parser-out-of-memory"])
    assert.match(refusalText(code, "Reading took long."), /^The terrain is too large.*reduce its triangles\.$/);
  assert.equal(refusalText("terrain-mesh-unreadable", "It is damaged."), "It is damaged.");
});

test("the other axis is not the one that the format has used", () => {
  assert.equal(otherUpAxis("stairs.stl", ""), "+y");
  assert.equal(otherUpAxis("Stairs.GLB", ""), "+z");
  assert.equal(otherUpAxis("stairs.glb", "+z"), "+y");
});

test("the end that has no surface is named", () => {
  const problem = (/** @type {string} */ where) => ({
    title: "Unprocessable",
    code: "terrain-without-foothold",
    errors: [{ where, message: "there is no surface at (9.00, 0.00) m" }],
  });
  assert.match(String(crossingAdvice(problem("start, left foot"))), /move the start/);
  assert.match(String(crossingAdvice(problem("goal, right foot"))), /move the goal/);
  assert.match(String(crossingAdvice({ title: "", code: "crossing-too-short" })), /0\.3 m/);
  assert.equal(crossingAdvice({ title: "", code: "robot-not-found" }), null);
});
