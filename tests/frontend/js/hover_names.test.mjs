// Names of what the mouse points at: the nearest within reach, forces at their heads with newtons, nothing that is hidden.
import test from "node:test";
import assert from "node:assert/strict";
import { labelText, namedPlaces, nearestName } from "../../../frontend/stridelab_web/static/js/viewer/hover_names.js";

const values = [0, 0, 1, 1, 0, 0, 300, 0, 400, NaN, 0, 0];
/** @type {any} */
const instant = {
  values,
  points: [
    ["/markers/0", 0, "LASI"],
    ["/markers/1", 9, "gap"],
    ["/com/fused", 0, "centre of mass"],
  ],
  arrows: [["/forces/plate1_shaft", "/forces/plate1_head", 3, "force on plate 1"]],
  arrowMPerN: 0.001,
  isHidden: (name) => name.startsWith("/com"),
};

test("points and heads of forces have names; gaps and hidden layers have none", () => {
  const places = namedPlaces(instant);
  assert.deepEqual(
    places.map(({ text }) => text),
    ["LASI", "force on plate 1: 500 N"],
  );
  assert.deepEqual(places[1].at, [1.3, 0, 0.4]);
  const momentum = { ...instant, arrows: [["/momentum_shaft", "/momentum_head", 3, "angular momentum"]] };
  assert.equal(namedPlaces(momentum).at(-1)?.text, "angular momentum");
  assert.equal(namedPlaces({ ...instant, arrowMPerN: 1e-6 }).length, 1, "an arrow that is not drawn has no name");
});

test("the nearest name within reach is shown", () => {
  const places = [
    { text: "near", at: [10, 10, 0] },
    { text: "nearer", at: [12, 10, 0] },
    { text: "behind the camera", at: [13, 10, -1] },
  ];
  /** @type {any} */
  const project = ([x, y, z]) => (z < 0 ? null : [x, y]);
  assert.equal(nearestName(places, [13, 10], project)?.text, "nearer");
  assert.equal(nearestName(places, [40, 10], project), null);
});

test("labels are in words", () => {
  assert.equal(labelText("force on left_foot"), "force on left foot");
  assert.equal(labelText("force on plate 2"), "force on plate 2");
});
