// Draws one picture of a stream of markers on two canvases: the body from the side or from behind, and from above the
// base of support with the CoM and the extrapolated CoM. Positions are in metres with z up; the CoM stays in the middle.
import { colour } from "../shared/colours.js";

/** @typedef {[number, number, number]} Point */
/**
 * @typedef {object} LivePicture
 * @property {(Point | null)[]} markers
 * @property {Record<string, Point | null>} joints
 * @property {Point | null} com
 * @property {Point | null} xcom
 * @property {Point[]} base
 * @property {Point | null} ahead
 */

const BONES = [
  ["vertex", "cervical"],
  ["cervical", "lumbar"],
  ...["l", "r"].flatMap((s) => [
    ["cervical", `${s}_shoulder`],
    [`${s}_shoulder`, `${s}_elbow`],
    [`${s}_elbow`, `${s}_wrist`],
    [`${s}_wrist`, `${s}_knuckles`],
    ["lumbar", `${s}_hip`],
    [`${s}_hip`, `${s}_knee`],
    [`${s}_knee`, `${s}_ankle`],
    [`${s}_ankle`, `${s}_forefoot`],
  ]),
];
const BODY_HEIGHT_M = 2.05;
const BASE_WIDTH_M = 1.3;

/** A canvas of the size that it has on the screen. @param {HTMLCanvasElement} canvas */
function prepared(canvas) {
  const ratio = window.devicePixelRatio || 1;
  const [width, height] = [canvas.clientWidth, canvas.clientHeight];
  if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
  }
  const pen = /** @type {CanvasRenderingContext2D} */ (canvas.getContext("2d"));
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.clearRect(0, 0, width, height);
  pen.lineCap = pen.lineJoin = "round";
  return { pen, width, height };
}

/** @param {CanvasRenderingContext2D} pen @param {[number, number]} at @param {number} radius @param {string} fill */
function dot(pen, [x, y], radius, fill) {
  pen.beginPath();
  pen.arc(x, y, radius, 0, 2 * Math.PI);
  pen.fillStyle = fill;
  pen.fill();
}

/** @param {CanvasRenderingContext2D} pen @param {[number, number]} at @param {string} edge */
function cross(pen, [x, y], edge) {
  pen.beginPath();
  pen.moveTo(x - 8, y);
  pen.lineTo(x + 8, y);
  pen.moveTo(x, y - 8);
  pen.lineTo(x, y + 8);
  pen.strokeStyle = edge;
  pen.lineWidth = 3;
  pen.stroke();
}

/** Horizontal coordinates along the walk and to the left. @param {Point} ahead */
const along = (ahead) => ({
  /** @param {Point} p */
  forwards: (p) => p[0] * ahead[0] + p[1] * ahead[1],
  /** @param {Point} p */
  leftwards: (p) => p[1] * ahead[0] - p[0] * ahead[1],
});

/** @param {LivePicture} picture @returns {Point | null} the CoM, else the middle of the markers */
export function middleOf(picture) {
  if (picture.com) return picture.com;
  const seen = /** @type {Point[]} */ (picture.markers.filter((marker) => marker !== null));
  if (!seen.length) return null;
  return /** @type {Point} */ ([0, 1, 2].map((axis) => seen.reduce((sum, p) => sum + p[axis], 0) / seen.length));
}

/** @param {HTMLCanvasElement} canvas @param {LivePicture} picture @param {string} view */
export function drawBody(canvas, picture, view) {
  const { pen, width, height } = prepared(canvas);
  const middle = middleOf(picture);
  if (!middle) return;
  const { forwards, leftwards } = along(picture.ahead ?? [1, 0, 0]);
  const across = view === "side" ? forwards : /** @param {Point} p */ (p) => -leftwards(p);
  const scale = height / BODY_HEIGHT_M;
  const floor = (picture.xcom ?? picture.base[0] ?? [0, 0, 0])[2];
  /** @param {Point} p @returns {[number, number]} */
  const place = (p) => [width / 2 + scale * (across(p) - across(middle)), height - 12 - scale * 0.96 * (p[2] - floor)];
  pen.fillStyle = colour("line");
  pen.fillRect(0, height - 12, width, 2);
  for (const marker of picture.markers) if (marker) dot(pen, place(marker), 1.8, colour("grey"));
  pen.lineWidth = 4;
  for (const [from, to] of BONES) {
    const [a, b] = [picture.joints[from], picture.joints[to]];
    if (!a || !b) continue;
    const right = from.startsWith("r_") || to.startsWith("r_");
    pen.strokeStyle = colour(right ? "orange-mid" : "slate");
    pen.beginPath();
    pen.moveTo(...place(a));
    pen.lineTo(...place(b));
    pen.stroke();
  }
  if (picture.xcom) cross(pen, place(picture.xcom), colour("orange-bright"));
  if (picture.com) {
    pen.setLineDash([4, 4]);
    pen.lineWidth = 1.5;
    pen.strokeStyle = colour("blue");
    pen.beginPath();
    pen.moveTo(...place(picture.com));
    pen.lineTo(place(picture.com)[0], height - 12);
    pen.stroke();
    pen.setLineDash([]);
    dot(pen, place(picture.com), 8, colour("blue"));
  }
}

/** @param {HTMLCanvasElement} canvas @param {LivePicture} picture */
export function drawBase(canvas, picture) {
  const { pen, width, height } = prepared(canvas);
  const middle = middleOf(picture);
  if (!middle) return;
  const { forwards, leftwards } = along(picture.ahead ?? [1, 0, 0]);
  const scale = Math.min(width, height) / BASE_WIDTH_M;
  /** @param {Point} p @returns {[number, number]} */
  const place = (p) => [
    width / 2 - scale * (leftwards(p) - leftwards(middle)),
    height * 0.6 - scale * (forwards(p) - forwards(middle)),
  ];
  pen.strokeStyle = colour("grid");
  pen.lineWidth = 1;
  for (let k = -10; k <= 10; k++) {
    const y = height * 0.6 + scale * (k / 10 + (((forwards(middle) % 0.1) + 0.1) % 0.1));
    pen.beginPath();
    pen.moveTo(0, y);
    pen.lineTo(width, y);
    pen.stroke();
  }
  if (picture.base.length > 2) {
    pen.beginPath();
    for (const corner of picture.base) pen.lineTo(...place(corner));
    pen.closePath();
    pen.fillStyle = colour("band");
    pen.fill();
    pen.strokeStyle = colour("blue");
    pen.lineWidth = 2;
    pen.stroke();
  }
  if (picture.com && picture.xcom) {
    pen.strokeStyle = colour("grey");
    pen.lineWidth = 2;
    pen.beginPath();
    pen.moveTo(...place(picture.com));
    pen.lineTo(...place(picture.xcom));
    pen.stroke();
  }
  if (picture.com) dot(pen, place(picture.com), 7, colour("blue"));
  if (picture.xcom) cross(pen, place(picture.xcom), colour("orange-bright"));
}
