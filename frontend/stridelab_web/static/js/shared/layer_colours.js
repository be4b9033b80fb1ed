// A legend of the scene: beside the name of each layer the colour in which it is drawn, if it has only one.

// Shows the colours now, and again when the page becomes dark or light.
/** @param {PageElement} player contains the swatches @param {import("../viewer/viser_nodes.js").ViserNodes} nodes */
export function showLayerColours(player, nodes) {
  const show = () => {
    for (const swatch of player.querySelectorAll("[data-swatch]")) {
      const colour = onlyColour(nodes, swatch.dataset.swatch);
      swatch.hidden = colour === null;
      if (colour) swatch.style.backgroundColor = colour;
    }
  };
  show();
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", show);
}

// The colour of all meshes of the nodes below `prefix`; null if they have several or none.
/** @param {Pick<import("../viewer/viser_nodes.js").ViserNodes, "viser" | "meshes">} nodes @param {string} prefix */
export function onlyColour(nodes, prefix) {
  const names = Object.keys(nodes.viser.nodeRefFromName).filter((name) => name.startsWith(prefix));
  const drawn = names.flatMap((name) => nodes.meshes(name)).filter(({ material }) => material?.color);
  const colours = new Set(drawn.map(({ material }) => `#${material.color.getHexString()}`));
  return colours.size === 1 ? [...colours][0] : null;
}
