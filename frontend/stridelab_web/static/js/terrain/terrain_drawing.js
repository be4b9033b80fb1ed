// The plan of a terrain as a drawing: surfaces coloured by height, stairs, rails, axes in metres, start and goal.
import { translate } from "../shared/translate.js";
import { barsOf, facesOf, heightRange, heightShare, layoutOf, ticksOf } from "./terrain_plan.js";

const SVG = "http://www.w3.org/2000/svg";
const MOST_PX = 520;
const TICK_PX = 5;
const ARROW_PX = 9;
const PLACE_PX = 8;
const ABOVE_PX = 6; // the line that a text names

/** @typedef {import("./terrain_plan.js").Layout} Layout */

// The colour of a height between the lowest (0) and the highest (1).
/** @param {number} share */
export const heightColour = (share) =>
  `color-mix(in oklab, var(--depth-3) ${Math.round(share * 100)}%, var(--depth-1))`;

// Draws a terrain into `svg`, as wide as it is on the page; returns how metres become its units.
/** @param {any} svg @param {import("./terrain_plan.js").ReadTerrain} read @returns {Layout} */
export function drawTerrain(svg, { terrain, stairs }) {
  const faces = facesOf(terrain),
    bars = barsOf(terrain),
    range = heightRange(faces);
  const layout = layoutOf(
    [...faces, ...bars].flatMap(({ outline }) => outline),
    Math.max(svg.clientWidth, 240),
    MOST_PX,
  );
  svg.setAttribute("viewBox", `0 0 ${layout.width} ${layout.height}`);
  const shapes = faces.map(({ name, outline, top, walkable }) => {
    const shape = drawPolygon(outline, layout, walkable ? "floor" : "wall");
    if (walkable) shape.style.fill = heightColour(heightShare(top[2], range));
    const z = top[2].toFixed(2);
    shape.append(
      svgElement("title", {}, walkable ? translate("%(name)s, %(height)s m high", { name, height: z }) : name),
    );
    return shape;
  });
  const rails = bars.map(({ name, outline }) => {
    const shape = drawPolygon(outline, layout, "rail");
    shape.append(svgElement("title", {}, name));
    return shape;
  });
  svg.replaceChildren(
    ...drawAxes(layout),
    ...shapes,
    ...rails,
    ...stairs.flatMap((flight, k) => drawAscent(flight, k + 1, layout)),
    ...bars.map(({ name, outline }) => drawLabel(middle(outline), name, layout)),
    svgElement("g", { "data-places": "" }),
  );
  return layout;
}

// Draws start and goal, where they are stated, and the straight way between them.
/** @param {any} svg @param {Layout} layout @param {Record<"start" | "goal", number[] | null>} places */
export function drawPlaces(svg, layout, { start, goal }) {
  const drawn = [];
  if (start && goal) {
    const [[x1, y1], [x2, y2]] = [start, goal].map(([x, y]) => layout.toPx(x, y));
    drawn.push(svgElement("line", { class: "way", x1, y1, x2, y2 }));
  }
  for (const [place, css, text] of /** @type {[number[] | null, string, string][]} */ ([
    [start, "start", translate("Start point")],
    [goal, "goal", translate("Goal point")],
  ])) {
    if (!place) continue;
    const [cx, cy] = layout.toPx(place[0], place[1]);
    drawn.push(svgElement("circle", { class: css, cx, cy, r: PLACE_PX }));
    drawn.push(svgElement("text", { class: "place", x: cx, y: cy - PLACE_PX - 5 }, text));
  }
  svg.querySelector("[data-places]").replaceChildren(...drawn);
}

// An arrow up the stairs, with their number.
/** @param {import("./terrain_plan.js").Stairs} stairs @param {number} number @param {Layout} layout */
function drawAscent({ start_m, heading_rad, run_m, treads }, number, layout) {
  const [x, y] = start_m,
    length = run_m * treads.length;
  const end = [x + length * Math.cos(heading_rad), y + length * Math.sin(heading_rad)];
  const [[x1, y1], [x2, y2]] = [[x, y], end].map(([a, b]) => layout.toPx(a, b));
  const tip = [-0.5, 0.5].map((turn) => {
    const angle = -heading_rad + Math.PI + turn; // y of the page points downwards
    return `${x2 + ARROW_PX * Math.cos(angle)},${y2 + ARROW_PX * Math.sin(angle)}`;
  });
  return [
    svgElement("line", { class: "ascent", x1, y1, x2, y2 }),
    svgElement("polyline", { class: "ascent", points: `${tip[0]} ${x2},${y2} ${tip[1]}` }),
    drawLabel([(x + end[0]) / 2, (y + end[1]) / 2], translate("Stairs %(number)s", { number }), layout),
  ];
}

/** @param {Layout} layout */
function drawAxes({ low, high, scale, toPx }) {
  const [left, bottom] = toPx(low[0], low[1]),
    [right, top] = toPx(high[0], high[1]);
  const nodes = [svgElement("rect", { class: "frame", x: left, y: top, width: right - left, height: bottom - top })];
  for (const x of ticksOf(low[0], high[0], scale)) {
    const [u] = toPx(x, low[1]);
    nodes.push(svgElement("line", { class: "grid", x1: u, x2: u, y1: top, y2: bottom + TICK_PX }));
    nodes.push(svgElement("text", { class: "tick", x: u, y: bottom + TICK_PX + 13 }, `${x}`));
  }
  for (const y of ticksOf(low[1], high[1], scale)) {
    const [, v] = toPx(low[0], y);
    nodes.push(svgElement("line", { class: "grid", x1: left - TICK_PX, x2: right, y1: v, y2: v }));
    nodes.push(svgElement("text", { class: "tick y", x: left - TICK_PX - 3, y: v + 4 }, `${y}`));
  }
  nodes.push(svgElement("text", { class: "tick unit", x: right, y: bottom + TICK_PX + 27 }, "x (m)"));
  nodes.push(svgElement("text", { class: "tick unit", x: left - TICK_PX - 3, y: top - 2 }, "y (m)"));
  return nodes;
}

/** @param {number[][]} outline */
const middle = (outline) => [0, 1].map((k) => outline.reduce((sum, point) => sum + point[k], 0) / outline.length);

/** @param {number[]} place @param {string} text @param {Layout} layout */
function drawLabel([x, y], text, layout) {
  const [u, v] = layout.toPx(x, y);
  return svgElement("text", { class: "named", x: u, y: v - ABOVE_PX }, text);
}

/** @param {number[][]} outline @param {Layout} layout @param {string} css */
function drawPolygon(outline, layout, css) {
  const points = outline.map(([x, y]) => layout.toPx(x, y).map((value) => value.toFixed(1)));
  return svgElement("polygon", { class: css, points: points.map((point) => point.join(",")).join(" ") });
}

/** @param {string} name @param {Record<string, string | number>} attributes @param {string} [text] @returns {any} */
function svgElement(name, attributes, text) {
  const made = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, String(value));
  if (text !== undefined) made.textContent = text;
  return made;
}
