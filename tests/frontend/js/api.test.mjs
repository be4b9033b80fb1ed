import assert from "node:assert/strict";
import test from "node:test";
import { jobHeadline, problemSentence } from "../../../frontend/stridelab_web/static/js/shared/api.js";

test("a problem is a sentence with its places and when to retry", () => {
  const problem = {
    title: "Invalid",
    detail: "Two fields are wrong.",
    errors: [{ where: "phases[0]", message: "too short" }],
  };
  assert.equal(problemSentence(422, problem), "Two fields are wrong. phases[0]: too short");
  const told = {
    title: "Refused",
    detail: "It begins with 'a': b.txt.",
    errors: [{ where: "b.txt", message: "it begins with 'a'" }],
  };
  assert.equal(problemSentence(422, told), told.detail);
  assert.equal(problemSentence(429, { title: "Too many jobs." }, "7"), "Too many jobs. Try again in 7 s.");
  assert.equal(problemSentence(502, null), "The service answered 502.");
  assert.equal(problemSentence(0, null), "The service does not answer. Is it still running?");
});

test("the headline of a job", () => {
  /** @type {any} */
  const progress = { message: "solving" };
  assert.equal(jobHeadline({ id: "j1", state: "queued", queue_position: 3, progress }), "place 3 in the queue");
  assert.equal(jobHeadline({ id: "j1", state: "queued", queue_position: null, progress }), "waiting");
  assert.equal(jobHeadline({ id: "j1", state: "running", progress }), "solving");
  assert.equal(jobHeadline({ id: "j1", state: "succeeded", progress }), "");
  assert.equal(
    jobHeadline({ id: "j1", state: "failed", error: { title: "Failed", detail: "No solution." }, progress }),
    "No solution.",
  );
});
