// The plan of a terrain as numbers: outlines of its surfaces, their heights, and the places of the page that they take.
import { rotate } from "../viewer/quaternions.js";
import { translate } from "../shared/translate.js";

const LEAST_UP = 0.5; // vertical part of the normal of a face on which a foot may be placed (pipelines/plan_contacts.py)
const MARGIN_M = 0.15;
const LEFT_PX = 44,
  BELOW_PX = 40,
  BESIDE_PX = 14; // for the numbers of the axes
const TICKS_APART_PX = 70;

/** @typedef {{ name: string, outline: number[][], top: number[], normal: number[], half: number[], axes: number[][], walkable: boolean }} Face */
/** @typedef {{ name: string, outline: number[][] }} Bar */
/** @typedef {{ rise_m: number, run_m: number, width_m: number, start_m: number[], heading_rad: number, treads: string[], rails: string[] }} Stairs */
/** @typedef {{ terrain: Surface[], stairs: Stairs[], remarks: string[] }} ReadTerrain */
/** @typedef {{ toPx: (x: number, y: number) => number[], toMetres: (u: number, v: number) => number[], width: number, height: number, low: number[], high: number[], scale: number }} Layout */

// The upper face of a box: its outline from above, its middle, its normal, and half its edges along its axes.
/** @param {Box} box @returns {Face} */
export function upperFace(box) {
  const yaw = (box.yaw_rad ?? 0) / 2;
  const wxyz = unitQuaternion(box.orientation_wxyz ?? [Math.cos(yaw), 0, 0, Math.sin(yaw)]);
  const axes = [0, 1, 2].map((k) => rotate(wxyz, /** @type {number[]} */ ([0, 1, 2].map((j) => Number(j === k)))));
  const half = box.size_m.map((edge) => edge / 2);
  const at = (/** @type {number[]} */ signs) =>
    [0, 1, 2].map((j) => box.center_m[j] + signs.reduce((sum, sign, k) => sum + sign * half[k] * axes[k][j], 0));
  const normal = axes[2];
  const walkable = normal[2] > LEAST_UP;
  const signs = [-1, 1].flatMap((x) => [-1, 1].flatMap((y) => (walkable ? [1] : [-1, 1]).map((z) => [x, y, z])));
  const outline = convexOutline(signs.map((one) => at(one).slice(0, 2)));
  return { name: box.name, outline, top: at([0, 0, 1]), normal, half, axes, walkable };
}

/** @param {Surface[]} terrain @returns {Face[]} the lowest first, as they are drawn */
export function facesOf(terrain) {
  const boxes = terrain.filter((surface) => surface.kind === "box");
  return boxes.map((box) => upperFace(/** @type {Box} */ (box))).sort((a, b) => a.top[2] - b.top[2]);
}

// A rail from above: as thick as it is, but at least 4 cm.
/** @param {Rail} rail @returns {Bar} */
export function barOf(rail) {
  const [ax, ay] = rail.from_m,
    [bx, by] = rail.to_m;
  const length = Math.hypot(bx - ax, by - ay),
    half = Math.max(rail.radius_m, 0.02);
  const [u, v] = length > 0 ? [((by - ay) / length) * half, ((ax - bx) / length) * half] : [half, 0];
  return {
    name: rail.name,
    outline: [
      [ax + u, ay + v],
      [bx + u, by + v],
      [bx - u, by - v],
      [ax - u, ay - v],
    ],
  };
}

/** @param {Surface[]} terrain @returns {Bar[]} */
export const barsOf = (terrain) =>
  terrain.filter((surface) => surface.kind === "rail").map((rail) => barOf(/** @type {Rail} */ (rail)));

// The height of the highest upper face at a place; null where there is none.
/** @param {Face[]} faces @param {number} x @param {number} y @returns {number | null} */
export function heightAt(faces, x, y) {
  let highest = /** @type {number | null} */ (null);
  for (const { top, normal, half, axes, walkable } of faces) {
    if (!walkable) continue;
    const z = top[2] - ((x - top[0]) * normal[0] + (y - top[1]) * normal[1]) / normal[2];
    const away = [x - top[0], y - top[1], z - top[2]];
    const inside = [0, 1].every((k) => Math.abs(away.reduce((sum, d, j) => sum + d * axes[k][j], 0)) <= half[k] + 1e-9);
    if (inside && (highest === null || z > highest)) highest = z;
  }
  return highest;
}

// The lowest and the highest middle of the faces on which one stands.
/** @param {Face[]} faces @returns {number[]} */
export function heightRange(faces) {
  const heights = faces.filter(({ walkable }) => walkable).map(({ top }) => top[2]);
  return heights.length ? [Math.min(...heights), Math.max(...heights)] : [0, 0];
}

// Where a height lies between the lowest and the highest, from 0 to 1; 0 on a terrain of one height.
/** @param {number} z @param {number[]} range */
export const heightShare = (z, [low, high]) =>
  high - low < 1e-6 ? 0 : Math.min(Math.max((z - low) / (high - low), 0), 1);

// How the terrain fits into a drawing: x to the right, y upwards, one scale for both.
/** @param {number[][]} points @param {number} width_px @param {number} most_px @returns {Layout} */
export function layoutOf(points, width_px, most_px) {
  const [low, high] = [Math.min, Math.max].map((pick) => [0, 1].map((k) => pick(...points.map((point) => point[k]))));
  const [least, most] = [low.map((v) => v - MARGIN_M), high.map((v) => v + MARGIN_M)];
  const [wide_m, high_m] = [most[0] - least[0], most[1] - least[1]];
  const inner_px = width_px - LEFT_PX - BESIDE_PX;
  const scale = Math.min(inner_px / wide_m, (most_px - BELOW_PX - BESIDE_PX) / high_m);
  const left = LEFT_PX + (inner_px - wide_m * scale) / 2;
  return {
    toPx: (x, y) => [left + (x - least[0]) * scale, BESIDE_PX + (most[1] - y) * scale],
    toMetres: (u, v) => [(u - left) / scale + least[0], most[1] - (v - BESIDE_PX) / scale],
    width: width_px,
    height: high_m * scale + BELOW_PX + BESIDE_PX,
    low: least,
    high: most,
    scale,
  };
}

// Round numbers between two ends, so far apart that their texts have room.
/** @param {number} low @param {number} high @param {number} px_per_m @returns {number[]} */
export function ticksOf(low, high, px_per_m) {
  const least = TICKS_APART_PX / px_per_m;
  const ten = 10 ** Math.floor(Math.log10(least));
  const step = /** @type {number} */ ([1, 2, 5, 10].map((k) => k * ten).find((each) => each >= least * 0.999));
  const first = Math.ceil(low / step - 1e-9);
  const count = Math.floor(high / step + 1e-9) - first + 1;
  return Array.from({ length: Math.max(count, 0) }, (_, k) => Number(((first + k) * step).toFixed(6)));
}

// A flight of stairs in words.
/** @param {Stairs} stairs @param {number} number counted from 1 */
export const stairsText = ({ treads, rise_m, run_m, width_m }, number) =>
  translate("Stairs %(number)s: %(treads)s treads, rise %(rise)s cm, run %(run)s cm, %(width)s m wide", {
    number,
    treads: treads.length,
    rise: (rise_m * 100).toFixed(1),
    run: (run_m * 100).toFixed(1),
    width: width_m.toFixed(2),
  });

/** @param {number[]} quaternion */
function unitQuaternion(quaternion) {
  const norm = Math.hypot(...quaternion) || 1;
  return quaternion.map((value) => value / norm);
}

// Convex outline of points of the plane (Andrew's monotone chain).
/** @param {number[][]} points */
function convexOutline(points) {
  const along = points.toSorted((a, b) => a[0] - b[0] || a[1] - b[1]);
  const chain = (/** @type {number[][]} */ sorted) => {
    /** @type {number[][]} */
    const turned = [];
    for (const point of sorted) {
      while (turned.length > 1 && cross(turned[turned.length - 2], turned[turned.length - 1], point) <= 1e-12)
        turned.pop();
      turned.push(point);
    }
    return turned.slice(0, -1);
  };
  return [...chain(along), ...chain(along.toReversed())];
}

/** @param {number[]} a @param {number[]} b @param {number[]} c */
const cross = (a, b, c) => (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
