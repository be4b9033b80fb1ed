import assert from "node:assert/strict";
import test from "node:test";
import {
  composePoses,
  relativePose,
  withCorner,
} from "../../../frontend/stridelab_web/static/js/viewer/card_contacts.js";
import { assertNear } from "./near.mjs";

const S = Math.SQRT1_2;
const turned = { position: [1, 2, 3], wxyz: [S, 0, 0, S] };

test("a pose in a link and back", () => {
  const inner = { position: [0.1, 0.2, 0.3], wxyz: [S, S, 0, 0] };
  const world = composePoses(turned, inner);
  assertNear(world.position, [0.8, 2.1, 3.3]);
  const again = relativePose(turned, world);
  assertNear(again.position, inner.position);
  assertNear(again.wxyz, inner.wxyz);
});

test("a corner is moved, the opposite one stays, also of a contact that is turned in its link", () => {
  const contact = {
    frame: "foot",
    kind: "surface",
    position_m: [0.5, 0, 0],
    orientation_wxyz: turned.wxyz,
    contact_half_size_m: [0.1, 0.05],
  };
  const moved = withCorner(contact, 0, [0.2, 0.15]);
  assertNear(moved.contact_half_size_m, [0.15, 0.1]);
  assertNear(moved.position_m, [0.45, 0.05, 0]); // the middle goes by (0.05, 0.05) in the turned frame
});

test("a sole keeps a least size when a corner is pulled over the opposite one's side", () => {
  const contact = {
    frame: "foot",
    kind: "surface",
    position_m: [0, 0, 0],
    orientation_wxyz: [1, 0, 0, 0],
    contact_half_size_m: [0.1, 0.05],
  };
  const flat = withCorner(contact, 2, [0.1, -0.05]);
  assert.deepEqual(flat.contact_half_size_m, [0.005, 0.05]);
  assertNear(flat.position_m, [0.095, 0, 0]);
});
