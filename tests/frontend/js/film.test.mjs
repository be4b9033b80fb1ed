import assert from "node:assert/strict";
import test from "node:test";
import { frameTimes } from "../../../frontend/stridelab_web/static/js/film/film.js";
import { choosePalette, GifWriter } from "../../../frontend/stridelab_web/static/js/film/gif.js";
import { webmFile } from "../../../frontend/stridelab_web/static/js/film/webm.js";

test("a film has both ends of its range, at its rate and speed", () => {
  assert.equal(frameTimes(2, 3, 25, 1).length, 26);
  assert.deepEqual(frameTimes(0, 0.5, 10, 0.5).at(-1), 0.5);
  assert.equal(frameTimes(0, 4, 10, 2).length, 21);
});

// The elements of a WebM file, as [id in hex, content], depth first.
/** @type {(bytes: Uint8Array, masters: Set<string>) => [string, Uint8Array][]} */
function elements(bytes, masters) {
  const out = [];
  let at = 0;
  while (at < bytes.length) {
    const idLength = Math.clz32(bytes[at]) - 23;
    const id = [...bytes.slice(at, at + idLength)].map((byte) => byte.toString(16).padStart(2, "0")).join("");
    const size = bytes.slice(at + idLength + 1, at + idLength + 8).reduce((sum, byte) => 256 * sum + byte, 0);
    at += idLength + 8;
    const content = bytes.slice(at, at + size);
    out.push([id, content], ...(masters.has(id) ? elements(content, masters) : []));
    at += size;
  }
  return out;
}
const MASTERS = new Set(["18538067", "1549a966", "1654ae6b", "ae", "e0", "1f43b675"]);

test("a WebM file has its size, its duration, and blocks at their times", () => {
  const chunk = (t_ms, isKey) => ({ data: new Uint8Array([1, 2, 3]), t_ms, isKey });
  const about = { codec: "V_VP8", width: 640, height: 300, duration_ms: 1040, app: "test" };
  const file = webmFile(about, [chunk(0, true), chunk(40, false), chunk(2000, true), chunk(2040, false)]);
  const found = elements(file, MASTERS);
  const of = (id) => found.filter(([each]) => each === id).map(([, content]) => content);
  assert.deepEqual([...of("b0")[0]], [2, 128]);
  assert.deepEqual([...of("ba")[0]], [1, 44]);
  assert.equal(new DataView(of("4489")[0].buffer).getFloat64(0), 1040);
  assert.equal(of("1f43b675").length, 2); // a cluster per key frame
  assert.deepEqual(
    of("a3").map((block) => [...block.slice(0, 4)]),
    [
      [0x81, 0, 0, 0x80],
      [0x81, 0, 40, 0],
      [0x81, 0, 0, 0x80],
      [0x81, 0, 40, 0],
    ],
  );
});

const pixels = (...colours) => new Uint8ClampedArray(colours.flatMap((colour) => [...colour, 255]));

test("few colours stay as they are, many become at most 255", () => {
  const palette = choosePalette([pixels([0, 0, 0], [255, 255, 255], [255, 0, 0])]);
  assert.deepEqual(palette.map(String).sort(), ["0,0,0", "255,0,0", "255,255,255"]);
  const many = Array.from({ length: 4096 }, (_, i) => [(i % 16) * 17, ((i >> 4) % 16) * 17, (i >> 8) * 17]);
  assert.equal(choosePalette([pixels(...many)]).length, 255);
});

test("a GIF writes a frame as a difference to the one before", () => {
  const writer = new GifWriter(
    2,
    1,
    [
      [0, 0, 0],
      [255, 255, 255],
    ],
    10,
  );
  writer.addFrame(pixels([0, 0, 0], [255, 255, 255]));
  writer.addFrame(pixels([0, 0, 0], [0, 0, 0]));
  const codes = (bytes) => [0, 1, 2].map((k) => ((bytes[k + 1] >> k) | (bytes[k + 2] << (8 - k))) & 511); // of 9 bits
  const [first, second] = [writer.parts[5], writer.parts[7]];
  assert.deepEqual(codes(first), [256, 0, 1]);
  assert.deepEqual(codes(second), [256, 255, 0]); // the first pixel stays
});
