import assert from "node:assert/strict";
import test from "node:test";
import {
  confidenceText,
  leastCertainFirst,
  proposalSentence,
} from "../../../frontend/stridelab_web/static/js/pages/marker_names.js";

const LANDMARKS = {
  c7: { label: "M1", confidence: 0.98 },
  l_heel: { label: "M2", confidence: 0.55 },
  r_heel: { label: "M3", confidence: 0.8 },
};

test("doubtful names come first and are marked in words", () => {
  assert.deepEqual(
    leastCertainFirst(LANDMARKS).map(([name]) => name),
    ["l_heel", "r_heel", "c7"],
  );
  assert.equal(confidenceText(0.55), "55 %, check");
  assert.equal(confidenceText(0.8), "80 %");
});

test("the sentence counts the landmarks and the markers without one", () => {
  assert.equal(proposalSentence(LANDMARKS, []), "Proposed: 3 landmarks, 1 of them to check.");
  assert.equal(
    proposalSentence(LANDMARKS, ["M4", "M5"]),
    "Proposed: 3 landmarks, 1 of them to check. No landmark for 2 markers.",
  );
});
