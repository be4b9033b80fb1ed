// Gives a node the meshes of another one, so that what is drawn twice is sent once; viser's node of a copy is empty.

// `nodes` is viser's table of three.js objects by name; `copies` are [name, of, paint] (Copy in frames.py).
export class Copies {
  constructor(copies) {
    this.copies = copies;
    this.made = new WeakMap(); // by the copy's object, from whose meshes: viser makes both anew after a lost connection
  }

  make(nodes) {
    for (const [name, of, paint] of this.copies) {
      const node = nodes[name],
        source = nodes[of];
      if (!node || !source) continue;
      const meshes = [];
      source.traverse((part) => part.isMesh && meshes.push(part));
      if (!meshes.length || this.made.get(node) === meshes[0].geometry) continue;
      this.made.set(node, meshes[0].geometry);
      node.remove(...node.children.filter((part) => part.userData.copied));
      for (const mesh of meshes) {
        const own = mesh.clone(false);
        own.material = painted(mesh.material, paint);
        own.userData = { copied: true };
        node.add(own);
      }
    }
  }
}

function painted(material, paint) {
  const own = material.clone();
  if (!paint) return own;
  const [rgb, opacity] = paint;
  own.color.setStyle(`rgb(${rgb})`);
  own.opacity = opacity;
  own.transparent = opacity < 1;
  return own;
}
