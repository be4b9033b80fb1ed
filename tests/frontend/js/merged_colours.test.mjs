// Parts of a link with different colours become one mesh: vertices, colours and triangles stay what they were.
import test from "node:test";
import assert from "node:assert/strict";
import { MergedColours, mergeArrays } from "../../../frontend/stridelab_web/static/js/viewer/merged_colours.js";

class Attribute {
  /** @param {any} array @param {number} size */
  constructor(array, size) {
    this.array = array;
    this.itemSize = size;
  }
}

class Geometry {
  constructor() {
    /** @type {any} */
    this.attributes = {};
    /** @type {any} */
    this.index = null;
  }
  /** @param {string} name @param {any} attribute */
  setAttribute(name, attribute) {
    this.attributes[name] = attribute;
  }
  /** @param {any} attribute */
  setIndex(attribute) {
    this.index = attribute;
  }
  computeVertexNormals() {}
  computeBoundingSphere() {}
}

class Material {
  /** @param {number[]} rgb */
  constructor([r, g, b]) {
    this.color = { r, g, b, setStyle: () => Object.assign(this.color, { r: 1, g: 1, b: 1 }) };
    this.vertexColors = false;
  }
  clone() {
    return new Material([this.color.r, this.color.g, this.color.b]);
  }
}

/** @param {number[]} position @param {number[]} index @param {number[]} rgb @returns {any} */
function mesh(position, index, rgb) {
  const geometry = new Geometry();
  geometry.setAttribute("position", new Attribute(new Float32Array(position), 3));
  geometry.setIndex(new Attribute(new Uint32Array(index), 1));
  return { isMesh: true, visible: true, userData: {}, geometry, material: new Material(rgb) };
}

const triangle = () => mesh([0, 0, 0, 1, 0, 0, 0, 1, 0], [0, 1, 2], [1, 0, 0]);
const square = () => mesh([0, 0, 1, 1, 0, 1, 1, 1, 1, 0, 1, 1], [0, 1, 2, 0, 2, 3], [0, 0, 0.5]);

test("each triangle keeps its corners and its colour", () => {
  const { position, color, index } = mergeArrays([triangle(), square()]);
  assert.deepEqual([...index], [0, 1, 2, 3, 4, 5, 3, 5, 6]);
  assert.deepEqual([...position.slice(9, 12)], [0, 0, 1]);
  assert.deepEqual([...color.slice(6, 12)], [1, 0, 0, 0, 0, 0.5]);
  assert.equal(color.length, position.length);
});

test("one mesh is drawn per link, again after new objects came, and only once for the same ones", () => {
  const [first, second] = [triangle(), square()],
    nodes = /** @type {any} */ ({
      "/robot/hand": { children: [first] },
      "/robot/hand/1": { children: [second] },
      "/robot/arm": { children: [triangle()] },
    });
  const merged = new MergedColours(["/robot/hand", "/robot/arm", "/robot/absent"]);
  const { material } = first;
  merged.update(nodes);
  assert.deepEqual([first.visible, second.visible], [true, false]);
  assert.equal(first.geometry.index.array.length, 9);
  assert.deepEqual([first.material.vertexColors, material.vertexColors], [true, false]);
  const { geometry } = first;
  merged.update(nodes);
  assert.equal(first.geometry, geometry);
  assert.equal(nodes["/robot/arm"].children[0].material.vertexColors, false);
  nodes["/robot/hand"] = { children: [triangle()] };
  merged.update(nodes); // half of the link is new: viser will make the other half, too
  assert.equal(nodes["/robot/hand"].children[0].geometry.index.array.length, 3);
  nodes["/robot/hand/1"] = { children: [square()] };
  merged.update(nodes);
  assert.equal(nodes["/robot/hand"].children[0].geometry.index.array.length, 9);
});
