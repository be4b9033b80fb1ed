import assert from "node:assert/strict";
import test from "node:test";
import { lineOfField } from "../../../frontend/stridelab_web/static/js/editor/json_view.js";

const TEXT = `{
  "name": "a \\"quoted\\" {name}",
  "phases": [
    { "duration_s": 1, "contacts": [] },
    {
      "duration_s": 2,
      "contacts": [
        { "effector": "left_foot",
          "position_m": [1,
            2, 3] }
      ]
    }
  ]
}`;

test("fields are found by key, by index and by effector", () => {
  assert.equal(lineOfField(TEXT, "name"), 1);
  assert.equal(lineOfField(TEXT, "phases[0].duration_s"), 3);
  assert.equal(lineOfField(TEXT, "phases[1].duration_s"), 5);
  assert.equal(lineOfField(TEXT, "phases[1].contacts[left_foot].position_m"), 8);
  assert.equal(lineOfField(TEXT, "phases[1].contacts[left_foot].position_m[1]"), 9);
});

test("a missing field is found by its nearest parent, and none in a broken text", () => {
  assert.equal(lineOfField(TEXT, "phases[1].contacts[right_foot]"), 6);
  assert.equal(lineOfField(TEXT, "friction"), null);
  assert.equal(lineOfField(TEXT.slice(1), "name"), null);
});
