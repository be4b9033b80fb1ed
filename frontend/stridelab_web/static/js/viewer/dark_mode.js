// Switches viser to dark mode with the page, and lightens dark lines and points there.
import { findContext } from "./viser_nodes.js";

const FLOOR_NODE = "/floor",
  DARK_BELOW = 0.42,
  LIGHTNESS = 0.64; // lightness, from 0 to 1
const GRID = { cellColor: "rgb(38, 46, 54)", sectionColor: "rgb(58, 68, 78)" };

export class DarkMode {
  // `names` are the nodes to lighten: lines and points; bodies keep their colours.
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
    this.nodes.viser.nodeRefFromName[FLOOR_NODE]?.traverse(({ material }) => {
      for (const [name, colour] of Object.entries(GRID))
        if (material?.uniforms?.[name]) this.tint(material.uniforms[name].value, (_, color) => color.setStyle(colour));
    });
    this.nodes.redraw();
  }

  syncTheme() {
    const { useGui } = findContext(this.nodes.frame) ?? {},
      theme = useGui?.get().theme;
    if (theme && theme.dark_mode !== this.dark.matches)
      useGui.set({ theme: { ...theme, dark_mode: this.dark.matches } });
  }

  // Restores the original colour, and changes it in dark mode.
  tint(color, change) {
    if (!color) return;
    if (!this.originalColors.has(color)) this.originalColors.set(color, color.clone());
    color.copy(this.originalColors.get(color));
    if (this.dark.matches) change(color.getHSL({}), color);
  }
}
