import assert from "node:assert/strict";
import test from "node:test";
import { counted } from "../../../frontend/stridelab_web/static/js/shared/plurals.js";

test("one is singular, every other number plural", () => {
  assert.equal(counted(1, "frame"), "1 frame");
  assert.equal(counted(0, "frame"), "0 frames");
  assert.equal(counted(2, "frame"), "2 frames");
});

test("an irregular plural is given", () => {
  assert.equal(counted(1, "person", "people"), "1 person");
  assert.equal(counted(3, "person", "people"), "3 people");
});
