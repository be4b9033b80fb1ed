// The legend of the scene: a layer has the colour of its nodes if it is the same for all of them.
import test from "node:test";
import assert from "node:assert/strict";
import { onlyColour } from "../../../frontend/stridelab_web/static/js/shared/layer_colours.js";

const mesh = (hex) => ({ material: { color: { getHexString: () => hex } } });
const drawn = {
  "/forces/plate1_shaft": [mesh("e28414")],
  "/forces/plate1_head": [mesh("e28414")],
  "/forces": [],
  "/contacts/left": [mesh("0b5c9c")],
  "/contacts/right": [mesh("e08a1e")],
  "/labels/1": [{ material: undefined }],
};
/** @type {any} */
const nodes = { viser: { nodeRefFromName: drawn }, meshes: (name) => drawn[name] };

test("a layer of one colour has it", () => assert.equal(onlyColour(nodes, "/forces/"), "#e28414"));
test("a layer of several colours has none", () => assert.equal(onlyColour(nodes, "/contacts/"), null));
test("a layer without meshes has none", () => {
  assert.equal(onlyColour(nodes, "/labels/"), null);
  assert.equal(onlyColour(nodes, "/reach/"), null);
});
