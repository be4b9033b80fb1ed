import assert from "node:assert/strict";
import test from "node:test";
import {
  courseBody,
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
