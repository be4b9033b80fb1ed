import assert from "node:assert/strict";
import test from "node:test";
import {
  addSurface,
  removeSurface,
  replaceSurface,
  setSurfaceNumber,
  SURFACE_FIELDS,
  surfaceNumbers,
} from "../../../frontend/stridelab_web/static/js/editor/terrain_edits.js";
import { fromAngles, rotate, toAngles } from "../../../frontend/stridelab_web/static/js/viewer/quaternions.js";
import { contact, phase, walk } from "./scenario.mjs";

/** @type {(a: number[], b: number[], tolerance?: number) => void} */
const near = (a, b, tolerance = 1e-6) =>
  assert.ok(Math.max(...a.map((v, i) => Math.abs(v - b[i]))) < tolerance, `${a} is not ${b}`);
const stair = () => ({
  ...walk(),
  terrain: [
    ...walk().terrain,
    { kind: "box", name: "stair", center_m: [1, 0, 0.05], size_m: [0.4, 1, 0.1], yaw_rad: 0 },
    { kind: "rail", name: "rail", from_m: [0, -0.5, 0.9], to_m: [2, -0.5, 0.9], radius_m: 0.02 },
  ],
  phases: [
    phase(
      1,
      contact("left_foot", 1.1, 0.1, 0.1),
      contact("right_foot", 0, -0.1, 0),
      contact("right_hand", 0.5, -0.5, 0.92),
    ),
  ],
});
const place = (scenario, effector) => scenario.phases[0].contacts.find((each) => each.effector === effector).position_m;

test("angles and orientations are inverse to each other", () => {
  near(toAngles(fromAngles(0.3, 0.2, -0.1)), [0.3, 0.2, -0.1]);
  near(rotate(fromAngles(Math.PI / 2, 0, 0), [1, 0, 0]), [0, 1, 0]);
  near(rotate(fromAngles(0, 0.2, 0), [1, 0, 0]), [Math.cos(0.2), 0, Math.sin(0.2)]); // upwards along x
});

test("a box is described by its upper face, and each number is set alone", () => {
  const [, box] = stair().terrain;
  const numbers = surfaceNumbers(box);
  assert.deepEqual(
    [numbers.x, numbers.y, numbers.top, numbers.length, numbers.width, numbers.height],
    [1, 0, 0.1, 0.4, 1, 0.1],
  );
  for (const [name, value] of Object.entries({ x: 2, top: 0.3, height: 0.25, slope: 8, lean: -3, turn: 40 })) {
    const changed = surfaceNumbers(setSurfaceNumber(box, name, value));
    for (const [other, number] of Object.entries(changed))
      near([number], [other === name ? value : numbers[other]], 1e-4);
  }
});

test("no edge and no radius is zero", () => {
  const least = Object.values(SURFACE_FIELDS).flatMap((fields) =>
    fields.filter(({ min }) => min).map(({ name }) => name),
  );
  assert.deepEqual(least, ["length", "width", "height", "radius"]);
});

test("a level box keeps its yaw, a tilted one has an orientation", () => {
  const [, box] = stair().terrain;
  assert.equal(setSurfaceNumber(box, "turn", 90).orientation_wxyz, null);
  const tilted = setSurfaceNumber(box, "slope", 10);
  assert.equal(tilted.yaw_rad, null);
  assert.equal(setSurfaceNumber(tilted, "slope", 0).orientation_wxyz, null);
});

test("contacts move with the surface on which they are, and only those", () => {
  const scenario = stair(),
    [, box, rail] = scenario.terrain;
  const raised = replaceSurface(scenario, 1, setSurfaceNumber(box, "top", 0.25));
  near(place(raised, "left_foot"), [1.1, 0.1, 0.25]);
  near(place(raised, "right_foot"), [0, -0.1, 0]);
  near(place(raised, "right_hand"), [0.5, -0.5, 0.92]);
  const higher = replaceSurface(scenario, 2, setSurfaceNumber(rail, "z2", 1.3));
  near(place(higher, "right_hand").slice(0, 2), [0.5, -0.5], 0.01); // the normal leans back
  near([place(higher, "right_hand")[2]], [1.0 + 0.02], 1e-3);
  near(place(higher, "left_foot"), [1.1, 0.1, 0.1]);
});

test("a foot on a box that is tilted stands along its face", () => {
  const scenario = stair();
  const tilted = replaceSurface(scenario, 1, setSurfaceNumber(scenario.terrain[1], "slope", 10));
  const foot = tilted.phases[0].contacts[0];
  near(toAngles(foot.orientation_wxyz), [0, (10 * Math.PI) / 180, 0]);
  near([foot.position_m[2]], [0.1 + 0.1 * Math.sin((10 * Math.PI) / 180)], 1e-4);
});

test("surfaces are added under names of their own, and removed", () => {
  let scenario = stair();
  for (const kind of /** @type {("box" | "wall" | "rail")[]} */ (["box", "box", "wall", "rail"]))
    scenario = addSurface(scenario, kind);
  assert.deepEqual(
    scenario.terrain.map(({ name }) => name),
    ["floor", "stair", "rail", "box 1", "box 2", "wall 1", "rail 1"],
  );
  assert.deepEqual(removeSurface(scenario, 1).terrain.length, 6);
});
