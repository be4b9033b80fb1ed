// Draws the parts of a link that differ in colour as one mesh with colours of the vertices: a draw call per link in place
// of one per colour. viser sends meshes of one colour, the further ones as nodes `<link>/1`, `<link>/2` below the link
// (viewer/robot_links.py).
export class MergedColours {
  /** @param {string[]} names nodes of the links */
  constructor(names) {
    this.names = names;
    /** @type {WeakSet<SceneObject>} */
    this.merged = new WeakSet(); // viser makes new objects after a lost connection
  }

  /** @param {Record<string, SceneObject | undefined>} nodes viser's three.js objects by name */
  update(nodes) {
    for (const name of this.names) {
      if (!nodes[`${name}/1`]) continue;
      const meshes = [];
      for (let node = nodes[name], k = 1; node; node = nodes[`${name}/${k}`], k += 1)
        meshes.push(...node.children.filter((part) => part.isMesh && !part.userData.copied));
      const [first, ...others] = meshes;
      if (!first || this.merged.has(first) || others.some((part) => this.merged.has(part))) continue;
      mergeMeshes(meshes);
      for (const mesh of meshes) this.merged.add(mesh);
    }
  }
}

/** @param {SceneObject[]} meshes */
function mergeMeshes(meshes) {
  const [first, ...others] = meshes;
  const { geometry, material } = first;
  const Geometry = /** @type {new () => Geometry} */ (geometry.constructor),
    Attribute = /** @type {new (array: ArrayLike<number>, size: number) => Attribute} */ (
      geometry.attributes.position.constructor
    );
  const merged = new Geometry();
  const { position, color, index } = mergeArrays(meshes);
  merged.setAttribute("position", new Attribute(position, 3));
  merged.setAttribute("color", new Attribute(color, 3));
  merged.setIndex(new Attribute(index, 1));
  merged.computeVertexNormals();
  merged.computeBoundingSphere();
  first.geometry = merged;
  first.material = material.clone(); // viser's own, which it may colour anew, is left as it is
  first.material.color.setStyle("white");
  first.material.vertexColors = true;
  for (const mesh of others) mesh.visible = false;
}

// Vertices, their colours and the triangles of meshes in the same frame, one after another.
/** @param {{ geometry: Geometry, material: Material }[]} meshes */
export function mergeArrays(meshes) {
  const counts = meshes.map(({ geometry }) => geometry.attributes.position.array.length / 3);
  const vertices = counts.reduce((sum, count) => sum + count, 0),
    corners = meshes.reduce((sum, { geometry }) => sum + geometry.index.array.length, 0);
  // The types of the frame's window: three.js does not take those of another window for arrays.
  const { attributes, index: order } = meshes[0].geometry;
  const Floats = /** @type {Float32ArrayConstructor} */ (attributes.position.array.constructor),
    Indices = /** @type {Uint32ArrayConstructor} */ (order.array.constructor);
  const position = new Floats(3 * vertices),
    color = new Floats(3 * vertices),
    index = new Indices(corners);
  let vertex = 0,
    corner = 0;
  for (const [k, { geometry, material }] of meshes.entries()) {
    const { r, g, b } = material.color;
    position.set(geometry.attributes.position.array, 3 * vertex);
    for (let i = vertex; i < vertex + counts[k]; i += 1) color.set([r, g, b], 3 * i);
    for (const own of geometry.index.array) {
      index[corner] = vertex + own;
      corner += 1;
    }
    vertex += counts[k];
  }
  return { position, color, index };
}
