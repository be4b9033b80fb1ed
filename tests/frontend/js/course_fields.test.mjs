import assert from "node:assert/strict";
import test from "node:test";
import {
  courseBody,
  dragElement,
  elementBody,
  KINDS,
  moveItem,
  newElement,
} from "../../../frontend/stridelab_web/static/js/editor/course_fields.js";

const HEAD = { name: " Stairs ", robot: "talos", friction: 0.5, width_m: 1.2, handrails: "left right" };

test("numbers become SI units", () => {
  assert.deepEqual(elementBody(newElement("stairs")), { kind: "stairs", number: 4, rise_m: 0.1, depth_m: 0.3 });
  const { slope_rad } = elementBody({ kind: "ramp", values: { length_m: 1, slope_rad: 90 } });
  assert.ok(Math.abs(slope_rad - Math.PI / 2) < 1e-6);
});

test("a beam is narrow level ground", () => {
  assert.deepEqual(elementBody(newElement("beam")), { kind: "level", length_m: 1.5, width_m: 0.45 });
});

test("every default lies inside its range", () => {
  for (const { fields } of Object.values(KINDS))
    for (const { value, min, max } of fields) assert.ok(value >= min && value <= max);
});

test("a course has its handrails as a list and a name", () => {
  const body = courseBody(HEAD, [newElement("gap")]);
  assert.deepEqual(body.handrails, ["left", "right"]);
  assert.equal(body.name, "Stairs");
  assert.deepEqual(courseBody({ ...HEAD, name: "", handrails: "" }, []).handrails, []);
  assert.equal(courseBody({ ...HEAD, name: " " }, []).name, "Course");
});

test("elements move inside the list only", () => {
  assert.deepEqual(moveItem(["a", "b", "c"], 0, 1), ["b", "a", "c"]);
  assert.deepEqual(moveItem(["a", "b", "c"], 2, -1), ["a", "c", "b"]);
  const list = ["a", "b"];
  assert.equal(moveItem(list, 0, -1), list);
  assert.equal(moveItem(list, 1, 1), list);
});

test("a handle changes the numbers of its element", () => {
  const stairs = dragElement(newElement("stairs"), 0.4, 0.2); // four stairs: 10 cm deeper, 5 cm higher each
  assert.deepEqual(stairs.values, { number: 4, rise_m: 15, depth_m: 40 });
  const { values } = dragElement(newElement("ramp"), 0.5, 0);
  const [before_m, after_m] = [1.5 * Math.tan((8 * Math.PI) / 180), 2 * Math.tan((values.slope_rad * Math.PI) / 180)];
  assert.ok(Math.abs(before_m - after_m) < 0.01, "a longer ramp ends at the same height");
  assert.equal(values.length_m, 2);
});

test("a dragged number stays in its range, at whole steps", () => {
  assert.equal(dragElement(newElement("bar"), -3, 0).values.thickness_m, 0.5);
  assert.equal(dragElement(newElement("box"), 0, 9).values.height_m, 50);
  assert.equal(dragElement(newElement("box"), 0.0123, 0).values.length_m, 41);
});

test("every kind with ground has a handle", () => {
  for (const kind of Object.keys(KINDS).filter((each) => each !== "gap"))
    assert.notDeepEqual(dragElement(newElement(kind), 0.4, 0.1), newElement(kind));
});
