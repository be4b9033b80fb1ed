// What the page of live streams says of one answer.
import assert from "node:assert/strict";
import test from "node:test";

import {
  describeMargin,
  describeMissing,
  standing,
} from "../../../frontend/stridelab_web/static/js/pages/live_text.js";

const answer = (ml, ap = 0.1) => ({ margin_m: { ml, ap }, margin_reason: null });

test("a margin turns from inside over the edge to outside, in words and in state", () => {
  const shown = [0.051, 0.004, -0.012].map((ml) => describeMargin("ml", answer(ml)));
  assert.deepEqual(
    shown.map(({ text, state, verdict }) => [text, state, verdict]),
    [
      ["+5.1 cm", "inside", "inside the base"],
      ["+0.4 cm", "near", "at the edge"],
      ["−1.2 cm", "outside", "outside the base"],
    ],
  );
});

test("ahead of the base is a step to come, not a fault", () => {
  const shown = describeMargin("ap", answer(0.05, -0.2));
  assert.equal(shown.state, "near");
  assert.match(shown.verdict, /a step must follow/);
});

test("the bar begins at zero and stays within its ends", () => {
  const [inside, outside, far] = [0.1, -0.1, 9].map((ml) => describeMargin("ml", answer(ml)));
  assert.equal(inside.left, 40);
  assert.ok(Math.abs(inside.width - 20) < 1e-9);
  assert.ok(Math.abs(outside.left + outside.width - 40) < 1e-9);
  assert.ok(far.left + far.width <= 100);
});

test("no margin is no number, with the reason", () => {
  const shown = describeMargin("ml", { margin_m: null, margin_reason: "feet-hidden" });
  assert.deepEqual([shown.text, shown.state, shown.width], ["–", "none", 0]);
  assert.match(shown.verdict, /hidden/);
});

test("what was missing is said, also under a code without words", () => {
  const bridged = { frames_lost: 1, markers_hidden: ["c7"], geometry: "coasted", force: "plate-late" };
  assert.equal(
    describeMissing({ reason: "some-code", bridged }),
    "No estimate: some code. 1 frame lost. Hidden: c7. Carried on by force or velocity. Markers only: a plate was not read.",
  );
  assert.equal(standing({ left: true, right: null }), "left foot");
});
