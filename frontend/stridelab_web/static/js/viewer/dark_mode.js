// Switches viser to dark mode with the page, lightens dark lines and points there, and darkens terrain and force plates.
import { findContext } from "./viser_nodes.js";

const FLOOR_NODE = "/floor",
  SURFACE_NODES = ["/terrain/", "/plates/"],
  TERRAIN = { ground: 0.025, lightest: 0.91, contrast: 0.25 }, // linear lightness: the ground is the lightest by day
  DARK_BELOW = 0.42,
  LIGHTNESS = 0.64; // lightness, from 0 to 1
const GRID = { cellColor: "rgb(38, 46, 54)", sectionColor: "rgb(58, 68, 78)" };

// Lightness by night of a surface of lightness `l` by day: edges and rails stay lighter than faces.
/** @param {number} l */
export function terrainLightness(l) {
  return TERRAIN.ground + Math.max(TERRAIN.lightest - l, 0) * TERRAIN.contrast;
}

export class DarkMode {
  // `names` are the nodes to lighten: lines and points; bodies keep their colours.
  /** @param {import("../viewer/viser_nodes.js").ViserNodes} nodes @param {string[]} [names] */
  constructor(nodes, names = []) {
    this.nodes = nodes;
    this.names = names;
    this.dark = matchMedia("(prefers-color-scheme: dark)");
    this.originalColors = new WeakMap();
    this.dark.addEventListener("change", () => this.apply());
    nodes.context.useGui.subscribe(() => this.syncTheme()); // viser's server sends its theme again after a lost connection
    this.apply();
  }

  apply() {
    this.syncTheme();
    for (const name of this.names)
      for (const { material } of this.nodes.meshes(name))
        this.tint(material.color, ({ h, s, l }, color) => l < DARK_BELOW && color.setHSL(h, s, LIGHTNESS));
    const drawn = this.nodes.viser.nodeRefFromName;
    drawn[FLOOR_NODE]?.traverse(({ material }) => this.tintGrid(material));
    for (const name of Object.keys(drawn))
      if (SURFACE_NODES.some((group) => name.startsWith(group)))
        drawn[name]?.traverse(({ material }) => {
          this.tintGrid(material);
          this.tint(material?.color, ({ h, s, l }, color) => color.setHSL(h, s, terrainLightness(l)));
        });
    this.nodes.redraw();
  }

  /** @param {Material} material */
  tintGrid(material) {
    for (const [name, colour] of Object.entries(GRID))
      if (material?.uniforms?.[name]) this.tint(material.uniforms[name].value, (_, color) => color.setStyle(colour));
  }

  syncTheme() {
    const { useGui } = findContext(this.nodes.frame) ?? {},
      theme = useGui?.get().theme;
    if (theme && theme.dark_mode !== this.dark.matches)
      useGui.set({ theme: { ...theme, dark_mode: this.dark.matches } });
  }

  // Restores the original colour, and changes it in dark mode.
  /** @param {Color} color @param {(hsl: { h: number, s: number, l: number }, color: Color) => unknown} change */
  tint(color, change) {
    if (!color) return;
    if (!this.originalColors.has(color)) this.originalColors.set(color, color.clone());
    color.copy(this.originalColors.get(color));
    if (this.dark.matches) change(color.getHSL({}), color);
  }
}
