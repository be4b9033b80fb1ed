import assert from "node:assert/strict";
import test from "node:test";
import {
  barsOf,
  facesOf,
  heightAt,
  heightRange,
  heightShare,
  layoutOf,
  stairsText,
  ticksOf,
  upperFace,
} from "../../../frontend/stridelab_web/static/js/terrain/terrain_plan.js";
import { assertNear } from "./near.mjs";

/** @param {number | number[]} actual @param {number | number[]} expected */
const near = (actual, expected) => assertNear([actual].flat(), [expected].flat(), 1e-9);

/** @type {(name: string, x: number, top: number, more?: object) => any} */
const box = (name, x, top, more = {}) => ({
  kind: "box",
  name,
  center_m: [x, 0, top - 0.1],
  size_m: [1, 2, 0.2],
  ...more,
});
const HALF = Math.SQRT1_2;
const WALL = box("wall", 0, 1, { orientation_wxyz: [HALF, 0, HALF, 0] });
/** @type {any} */
const RAIL = { kind: "rail", name: "rail 1", from_m: [0, -1, 0.9], to_m: [2, -1, 0.9], radius_m: 0.03 };

test("an upper face is seen from above, turned as its box is", () => {
  const { outline, top, walkable } = upperFace(box("tread", 3, 0.5));
  assert.equal(walkable, true);
  near(top, [3, 0, 0.5]);
  assert.equal(outline.length, 4);
  near(Math.max(...outline.map(([x]) => x)), 3.5);
  const turned = upperFace(box("tread", 3, 0.5, { yaw_rad: Math.PI / 2 })).outline;
  near(Math.max(...turned.map(([x]) => x)), 4);
  near(Math.max(...turned.map(([, y]) => y)), 0.5);
});

test("a quaternion need not be of unit length", () => {
  near(upperFace(box("tread", 0, 0, { orientation_wxyz: [5, 0, 0, 0] })).top, [0, 0, 0]);
});

test("a wall has an outline and no height on which one stands", () => {
  const face = upperFace(WALL);
  assert.equal(face.walkable, false);
  near(Math.max(...face.outline.map(([x]) => x)), 0.1);
  assert.equal(heightAt([face], 0, 0), null);
  assert.deepEqual(heightRange([face]), [0, 0]);
});

test("the highest surface below a place counts, also on a ramp", () => {
  const slope = Math.atan(0.5);
  const ramp = box("ramp", 0, 0.1, { orientation_wxyz: [Math.cos(slope / 2), 0, -Math.sin(slope / 2), 0] });
  const faces = facesOf([box("tread", 5, 0.7), box("floor", 5, 0.2), ramp]);
  assert.deepEqual(
    faces.map(({ name }) => name),
    ["ramp", "floor", "tread"],
  );
  near(Number(heightAt(faces, 5.4, -0.9)), 0.7);
  assert.equal(heightAt(faces, 5.6, 0), null);
  const middle = Number(heightAt(faces, 0, 0));
  near(Number(heightAt(faces, 0.2, 0)) - middle, 0.1);
});

test("heights are shared between the lowest and the highest", () => {
  const range = heightRange(facesOf([box("a", 0, 0.2), box("b", 0, 0.6), WALL]));
  near(range, [0.2, 0.6]);
  near(heightShare(0.4, range), 0.5);
  assert.equal(heightShare(9, range), 1);
  assert.equal(heightShare(0.4, [0.4, 0.4]), 0);
});

test("a rail is as long as it is, and never thinner than 4 cm", () => {
  const [{ outline }] = barsOf([RAIL, box("a", 0, 0)]);
  near(Math.max(...outline.map(([, y]) => y)), -0.97);
  near(Math.max(...outline.map(([x]) => x)), 2);
  const [standing] = barsOf([{ ...RAIL, to_m: [0, -1, 2], radius_m: 0.001 }]);
  assert.ok(standing.outline.flat().every(Number.isFinite));
});

test("a layout keeps one scale, and a place of the page is that of the terrain", () => {
  for (const points of [
    [
      [0, 0],
      [10, 1],
    ],
    [
      [-1, 3],
      [0, 60],
    ],
  ]) {
    const { toPx, toMetres, width, height } = layoutOf(points, 390, 520);
    assert.equal(width, 390);
    assert.ok(height <= 520 + 1e-6);
    for (const [x, y] of points) {
      const [u, v] = toPx(x, y);
      assert.ok(u >= 0 && u <= width && v >= 0 && v <= height);
      near(toMetres(u, v), [x, y]);
    }
    const [[u1, v1], [u2, v2]] = points.map(([x, y]) => toPx(x, y));
    near((u2 - u1) / (points[1][0] - points[0][0]), (v1 - v2) / (points[1][1] - points[0][1]));
    assert.ok(v2 < v1, "y is upwards");
  }
});

test("ticks are round numbers with room for their texts", () => {
  assert.deepEqual(ticksOf(-0.6, 2.6, 100), [0, 1, 2]);
  assert.deepEqual(ticksOf(-0.25, 0.25, 700), [-0.2, -0.1, 0, 0.1, 0.2]);
  assert.deepEqual(ticksOf(0, 100, 3), [0, 50, 100]);
  assert.deepEqual(ticksOf(0.3, 0.4, 10), []);
});

test("stairs are described by their numbers", () => {
  const stairs = {
    rise_m: 0.17,
    run_m: 0.28,
    width_m: 1,
    start_m: [0, 0, 0],
    heading_rad: 0,
    treads: ["a", "b"],
    rails: [],
  };
  assert.equal(stairsText(stairs, 1), "Stairs 1: 2 treads, rise 17.0 cm, run 28.0 cm, 1.00 m wide");
});
