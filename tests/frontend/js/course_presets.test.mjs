// Courses to start from: the flights of a house, out of doors, and one that is too steep.
import assert from "node:assert/strict";
import test from "node:test";

import { courseBody } from "../../../frontend/stridelab_web/static/js/editor/course_fields.js";
import { PRESETS, presetCourse } from "../../../frontend/stridelab_web/static/js/editor/course_presets.js";

const HEAD = { name: "Course", robot: "g1", handrails: "", width_m: 1.2, friction: 0.4 };

test("a preset changes name, handrails and obstacles alone", () => {
  for (const key of Object.keys(PRESETS)) {
    const { head, elements } = presetCourse(key, HEAD);
    assert.deepEqual({ ...head, name: "", handrails: "" }, { ...HEAD, name: "" });
    assert.equal(elements.length, 1);
  }
});

test("the stairs of a house are sent in metres with both handrails", () => {
  const { head, elements } = presetCourse("house", HEAD);
  const body = courseBody(/** @type {any} */ (head), elements);
  assert.deepEqual(body.handrails, ["left", "right"]);
  assert.deepEqual(body.elements, [{ kind: "stairs", number: 5, rise_m: 0.17, depth_m: 0.28 }]);
});
