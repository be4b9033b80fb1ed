import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import test from "node:test";
import { decodeFrames } from "../../../frontend/stridelab_web/static/js/viewer/frame_decoder.js";

// Written by the Python encoder (tests/frontend/scene/test_frame_fixture.py).
const fixture = JSON.parse(readFileSync(new URL("frames.json", import.meta.url), "utf-8"));
const bufferOf = (bytes) => new Uint8Array(bytes).buffer;
const [layout, values] = decodeFrames(bufferOf(Buffer.from(fixture.file, "base64")));

test("the layout of the Python encoder is read", () => {
  assert.equal(layout.n_frames, fixture.values.length);
  assert.equal(layout.width, fixture.values[0].length);
  assert.deepEqual(layout.bodies, [["/robot/pelvis", 3]]);
  assert.deepEqual(layout.phase_starts_s, [0, 0.1]);
  assert.deepEqual(layout.bits.slice(0, 4), [20, 20, 20, 16]);
});

test("every value is within half a step of what was encoded, and gaps are NaN", () => {
  for (const [frame, row] of fixture.values.entries()) {
    for (const [column, expected] of row.entries()) {
      const value = values[frame * layout.width + column];
      if (expected === null) assert.ok(Number.isNaN(value), `frame ${frame}, column ${column} is a gap`);
      else {
        const tolerance = 0.5 * 2 ** -layout.bits[column] + 1e-7 * Math.abs(expected);
        assert.ok(Math.abs(value - expected) <= tolerance, `frame ${frame}, column ${column}: ${value}, ${expected}`);
      }
    }
  }
});

test("second differences are summed up by hand", () => {
  // One column of step 1/4 with the integers 2, 5, 3: second differences 2, 1, -5; without sign 4, 2, 9.
  const header = new TextEncoder().encode(JSON.stringify({ n_frames: 3, width: 1, bits: [2] }));
  const bytes = [header.length, 0, 0, 0, ...header, 0, 1, 0, 4, 2, 9, 0, 0, 0, 0, 0, 0, 0, 0, 0];
  assert.deepEqual([...decodeFrames(bufferOf(bytes))[1]], [0.5, NaN, 0.75]);
});

test("all four bytes count, and the lowest bit is the sign", () => {
  const header = new TextEncoder().encode(JSON.stringify({ n_frames: 1, width: 2, bits: [0, 0] }));
  // 0x01020304 is even: 0x00810182; 0xffffffff is odd: -2 ** 31.
  const planes = [
    [0, 0],
    [0x04, 0xff],
    [0x03, 0xff],
    [0x02, 0xff],
    [0x01, 0xff],
  ].flat();
  const decoded = decodeFrames(bufferOf([header.length, 0, 0, 0, ...header, ...planes]))[1];
  assert.deepEqual([...decoded], [0x00810182, -(2 ** 31)]);
});
