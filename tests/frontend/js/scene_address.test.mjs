import assert from "node:assert/strict";
import test from "node:test";
import {
  isLayerShown,
  readCamera,
  sameCamera,
  writeCamera,
  writeLayers,
} from "../../../frontend/stridelab_web/static/js/viewer/scene_address.js";

const layer = (prefix, byDefault, checked = byDefault) => ({ prefix, byDefault, checked });

test("only layers that differ from their default are in the address", () => {
  const query = new URLSearchParams("t=1&show=old");
  writeLayers(query, [layer("/forces/", true, false), layer("/cones/", false, true), layer("/paths/", true)]);
  assert.equal(query.get("hide"), "forces");
  assert.equal(query.get("show"), "cones");
  writeLayers(query, [layer("/forces/", true), layer("/cones/", false)]);
  assert.equal(query.toString(), "t=1");
});

test("layers are read as they were written, and others keep their default", () => {
  const query = new URLSearchParams("show=com/band,cones&hide=forces/plate");
  assert.equal(isLayerShown(query, "/com/band", false), true);
  assert.equal(isLayerShown(query, "/cones/", false), true);
  assert.equal(isLayerShown(query, "/forces/plate", true), false);
  assert.equal(isLayerShown(query, "/forces/total", true), true);
  assert.equal(isLayerShown(query, "/inputs/axis/", false), false);
});

test("a camera is six numbers; anything else is none", () => {
  const query = new URLSearchParams();
  writeCamera(query, [1.23456, -2, 0, 4, 5, 6]);
  assert.deepEqual(readCamera(query), [1.235, -2, 0, 4, 5, 6]);
  for (const text of ["", "1,2,3", "1,2,3,4,5,x"])
    assert.equal(readCamera(new URLSearchParams({ camera: text })), null);
  assert.equal(sameCamera([1, 2, 3, 4, 5, 6], [1.001, 2, 3, 4, 5, 6]), true);
  assert.equal(sameCamera([1, 2, 3, 4, 5, 6], [1.01, 2, 3, 4, 5, 6]), false);
});
