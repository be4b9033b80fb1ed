// Copies the meshes of a node to another, empty one, so that the server sends them once. `copies` are
// [name, original, paint] (Copy in frames.py).

/** @typedef {[number[], number]} Paint colour (red, green, blue) and opacity */

export class MeshCopies {
  /** @param {[string, string, Paint | null][]} copies */
  constructor(copies) {
    this.copies = copies;
    this.sources = new WeakMap(); // geometry by the object of its copy; viser makes new objects after a lost connection
  }

  // `nodes` are viser's three.js objects by name.
  /** @param {Record<string, SceneObject | undefined>} nodes */
  update(nodes) {
    for (const [name, original, paint] of this.copies) {
      const node = nodes[name],
        source = nodes[original];
      if (!node || !source) continue;
      /** @type {SceneObject[]} */
      const meshes = [];
      source.traverse((part) => part.isMesh && part.visible && meshes.push(part));
      if (!meshes.length || this.sources.get(node) === meshes[0].geometry) continue;
      this.sources.set(node, meshes[0].geometry);
      node.remove(...node.children.filter((part) => part.userData.copied));
      for (const mesh of meshes) {
        const copy = mesh.clone(false);
        copy.material = copyMaterial(mesh.material, paint);
        copy.userData = { copied: true };
        node.add(copy);
      }
    }
  }
}

/** @param {Material} material @param {Paint | null} paint */
function copyMaterial(material, paint) {
  const copy = material.clone();
  if (!paint) return copy;
  const [rgb, opacity] = paint;
  copy.vertexColors = false;
  copy.color.setStyle(`rgb(${rgb})`);
  copy.opacity = opacity;
  copy.transparent = opacity < 1;
  return copy;
}
