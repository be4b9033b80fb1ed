// viser's own dark mode follows the page's, and dark lines and points become light in it.
import { findContext } from "./viser_nodes.js";

const FLOOR = "/floor",
  DARKEST = 0.42,
  LIGHT = 0.64; // lightness, from 0 to 1
const GRID = { cellColor: "rgb(38, 46, 54)", sectionColor: "rgb(58, 68, 78)" };

export class Room {
  // `names` are nodes that stand before the background; bodies have a shade of their own.
  constructor(nodes, names = []) {
    this.nodes = nodes;
    this.names = names;
    this.dark = matchMedia("(prefers-color-scheme: dark)");
    this.own = new WeakMap();
    this.dark.addEventListener("change", () => this.show());
    nodes.context.useGui.subscribe(() => this.theme()); // viser's server tells its theme again after a lost connection
    this.show();
  }

  show() {
    this.theme();
    for (const name of this.names)
      for (const { material } of this.nodes.meshes(name))
        this.tint(material.color, ({ h, s, l }, color) => l < DARKEST && color.setHSL(h, s, LIGHT));
    this.nodes.viser.nodeRefFromName[FLOOR]?.traverse(({ material }) => {
      for (const [name, colour] of Object.entries(GRID))
        if (material?.uniforms?.[name]) this.tint(material.uniforms[name].value, (_, color) => color.setStyle(colour));
    });
    this.nodes.redraw();
  }

  theme() {
    const { useGui } = findContext(this.nodes.frame) ?? {},
      theme = useGui?.get().theme;
    if (theme && theme.dark_mode !== this.dark.matches)
      useGui.set({ theme: { ...theme, dark_mode: this.dark.matches } });
  }

  // Its own colour in the light, another one in the dark.
  tint(color, change) {
    if (!color) return;
    if (!this.own.has(color)) this.own.set(color, color.clone());
    color.copy(this.own.get(color));
    if (this.dark.matches) change(color.getHSL({}), color);
  }
}
