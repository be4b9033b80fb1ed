// Colours of the style sheet (css/colours.css) for scripts that draw, and a callback when the colour scheme changes.
/** @param {string} name */
export const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();

/** @param {() => void} redraw */
export function onColourScheme(redraw) {
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);
}
