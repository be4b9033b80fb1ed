import assert from "node:assert/strict";
import test, { beforeEach } from "node:test";
import { CourseHistory } from "../../../frontend/stridelab_web/static/js/editor/course_history.js";

const session = new Map();
let isFull = false;
beforeEach(() => {
  session.clear();
  isFull = false;
});
/** @type {any} */ (globalThis).sessionStorage = {
  getItem: (key) => session.get(key) ?? null,
  setItem: (key, value) => {
    if (isFull) throw new Error("full");
    session.set(key, value);
  },
  removeItem: (key) => session.delete(key),
};

test("steps are undone and redone in order", () => {
  const history = new CourseHistory("c", { n: 0 });
  for (const n of [1, 2, 2]) history.record({ n }); // the last one changes nothing
  assert.deepEqual(history.undo(), { n: 1 });
  assert.deepEqual(history.undo(), { n: 0 });
  assert.equal(history.canUndo, false);
  assert.deepEqual(history.undo(), { n: 0 });
  assert.deepEqual(history.redo(), { n: 1 });
  history.record({ n: 7 });
  assert.equal(history.canRedo, false);
  assert.deepEqual(history.undo(), { n: 1 });
});

test("a reload of the page restores the steps", () => {
  const history = new CourseHistory("c", { n: 0 });
  history.record({ n: 1 });
  const again = new CourseHistory("c", { n: 5 });
  assert.deepEqual(again.present, { n: 1 });
  assert.deepEqual(again.undo(), { n: 0 });
});

test("without storage, and with a broken one, the page works", () => {
  session.set("c", "{");
  isFull = true;
  const history = new CourseHistory("c", { n: 0 });
  history.record({ n: 1 });
  assert.deepEqual(history.undo(), { n: 0 });
});
