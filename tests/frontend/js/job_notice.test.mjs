import assert from "node:assert/strict";
import test from "node:test";
import { notifyOfEnd, outcomeText } from "../../../frontend/stridelab_web/static/js/shared/job_notice.js";

/** @type {any} */
const job = { id: "j1", state: "succeeded", progress: { message: "" } };

test("the outcome of a job is its verdict, else its reason, else its state", () => {
  const verdict = { outcome: "failed", message: "Not certified: terrain distance" };
  assert.equal(outcomeText({ ...job, verdict }), "✗ Not certified: terrain distance");
  assert.equal(outcomeText({ ...job, verdict: { outcome: "passed", message: "Certified" } }), "✓ Certified");
  assert.equal(outcomeText({ ...job, verdict: { outcome: "doubtful", message: "Doubtful" } }), "! Doubtful");
  assert.equal(outcomeText({ ...job, state: "failed", error: { detail: "No solution." } }), "✗ No solution.");
  assert.equal(outcomeText({ ...job, state: "timed_out" }), "✗ timed out");
  assert.equal(outcomeText(job), "✓ succeeded");
});

test("without notifications in the browser there is none, and no error", () => {
  globalThis.document = /** @type {any} */ ({ hidden: true, title: "Plan" });
  notifyOfEnd(job);
});
