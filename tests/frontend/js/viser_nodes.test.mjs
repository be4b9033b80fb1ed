// When a scene is drawn as it was moved, and when its objects were made anew.
import assert from "node:assert/strict";
import test from "node:test";

/** @type {any} */ (globalThis).document = {
  documentElement: {},
  querySelector: () => null,
  getElementById: () => null,
};
const { ViserNodes } = await import("../../../frontend/stridelab_web/static/js/viewer/viser_nodes.js");

// Nodes of a client of viser that has made `objects`, with the states of their poses.
function nodesOf(states, objects) {
  const current = {
    nodePoseData: Object.fromEntries(states.map((poseUpdateState, k) => [`/${k}`, { poseUpdateState }])),
    nodeRefFromName: Object.fromEntries(objects.map((object, k) => [`/${k}`, object])),
  };
  /** @type {any} */
  const frame = { contentWindow: { viserScene: { mutable: { current } } } };
  const nodes = new ViserNodes(
    frame,
    states.map((_, k) => `/${k}`),
  );
  nodes.refreshClient();
  return nodes;
}

test("a scene is placed once every node has its object where it was moved", () => {
  assert.equal(nodesOf(["updated", "updated"], [{}, {}]).isPlaced(), true);
  assert.equal(nodesOf(["updated", "needsUpdate"], [{}, {}]).isPlaced(), false);
  assert.equal(nodesOf(["updated", "waitForMakeObject"], [{}, undefined]).isPlaced(), false);
});

test("nodes that a lost connection took away are not placed", () => {
  const nodes = nodesOf(["updated", "updated"], [{}, {}]);
  delete nodes.viser.nodePoseData["/1"];
  assert.equal(nodes.isPlaced(), false);
});

test("objects made anew since the last drawing are stale", () => {
  const nodes = nodesOf(["updated"], [{}]);
  nodes.draw();
  assert.equal(nodes.isStale(), false);
  nodes.viser.nodeRefFromName["/0"] = /** @type {any} */ ({});
  assert.equal(nodes.isStale(), true);
});
