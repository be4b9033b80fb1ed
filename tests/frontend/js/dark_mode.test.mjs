// By night, surfaces of terrain and force plates are dark, bodies keep their colours, and lines are light.
import assert from "node:assert/strict";
import test from "node:test";

globalThis.matchMedia = /** @type {any} */ (() => ({ matches: true, addEventListener: () => {} }));
const { DarkMode } = await import("../../../frontend/stridelab_web/static/js/viewer/dark_mode.js");

/** @param {number} l */
function colour(l) {
  /** @type {any} */
  const one = {
    l,
    clone: () => ({ l: one.l }),
    copy: (other) => (one.l = other.l),
    getHSL: () => ({ h: 0, s: 0, l: one.l }),
  };
  one.setHSL = (_h, _s, lightness) => (one.l = lightness);
  return one;
}

test("plates and terrain are darkened, the named lines are lightened", () => {
  const drawn = Object.fromEntries(
    Object.entries({ "/plates/1": 0.7, "/terrain/0": 0.9, "/body/skin": 0.6, "/live/planned": 0 }).map(([name, l]) => {
      const mesh = { isMesh: true, material: { color: colour(l) } };
      return [name, { mesh, traverse: (/** @type {(part: object) => void} */ visit) => visit(mesh) }];
    }),
  );
  /** @type {any} */
  const nodes = {
    viser: { nodeRefFromName: drawn },
    frame: {},
    context: { useGui: { subscribe: () => {}, get: () => ({}) } },
    meshes: (name) => [drawn[name].mesh],
    redraw: () => {},
  };
  new DarkMode(nodes, ["/live/planned"]);
  const lightness = (name) => drawn[name].mesh.material.color.l;
  assert.ok(lightness("/plates/1") < 0.2, "a plate glares");
  assert.ok(lightness("/terrain/0") < 0.2, "the ground glares");
  assert.equal(lightness("/body/skin"), 0.6);
  assert.ok(lightness("/live/planned") > 0.5, "a path is not seen");
});
