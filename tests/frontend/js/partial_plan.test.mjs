import assert from "node:assert/strict";
import test from "node:test";
import { PartialPlan, PartialReader, posesAt } from "../../../frontend/stridelab_web/static/js/editor/partial_plan.js";
import { PlanPlayback, PlaybackClock } from "../../../frontend/stridelab_web/static/js/editor/plan_playback.js";
import { assertNear } from "./near.mjs";

const isNear = (actual, expected) => assertNear([actual], [expected], 1e-9);
const posesThere = (list, t_s) => posesAt(list, t_s) ?? [];

const pose = (x, qw = 1, qz = 0) => [[x, 0, 0, qw, 0, 0, qz]];
const check = (name, passed) => ({ name, passed });
const START = { kind: "plan", robot: "talos", links: ["base"], duration_s: 2, phase_ends_s: [0.5, 2] };
const frames = (kind, run, ...times) => ({ kind, run, time_s: times, poses: times.map((t) => pose(t)) });

test("frames are appended, and a new run replaces the one before", () => {
  const plan = new PartialPlan();
  plan.add({ attempt: 1, chunks: [START, frames("motion", 1, 0, 0.1), frames("motion", 1, 0.2)] });
  assert.deepEqual(plan.motion.time_s, [0, 0.1, 0.2]);
  assert.deepEqual(plan.phaseEnds_s, [0.5, 2]);
  plan.add({ attempt: 1, chunks: [frames("motion", 2, 0, 0.04)] });
  assert.deepEqual(plan.motion.time_s, [0, 0.04]);
  plan.add({ attempt: 1, chunks: [frames("replay", undefined, 0, 0.4)] });
  assert.deepEqual(plan.replay.time_s, [0, 0.4]);
  assert.deepEqual(plan.motion.time_s, [0, 0.04]);
});

test("another attempt begins anew", () => {
  const plan = new PartialPlan();
  plan.add({
    attempt: 1,
    chunks: [START, frames("motion", 1, 0, 0.1), { kind: "certificate", checks: [check("a", false)] }],
  });
  plan.add({ attempt: 2, chunks: [] });
  assert.deepEqual([plan.motion.time_s, plan.checks, plan.links], [[], [], []]);
});

test("the certificate is shown as it fills", () => {
  const plan = new PartialPlan();
  assert.equal(plan.certificateText, "");
  plan.add({ attempt: 1, chunks: [{ kind: "certificate", checks: [check("com_error_max", true)], passed: null }] });
  assert.equal(plan.certificateText, "Certificate so far: 1 check passed.");
  plan.add({
    attempt: 1,
    chunks: [{ kind: "certificate", checks: [check("self_collision_pairs", false)], passed: null }],
  });
  assert.equal(plan.certificateText, "Certificate so far: 1 check passed; failed: self collision pairs.");
  assert.equal(plan.passed, null);
  plan.add({ attempt: 1, chunks: [{ kind: "certificate", checks: [], passed: false }] });
  assert.equal(plan.certificateText, "Not certified: self collision pairs.");
});

test("poses between frames are linear, the short way round", () => {
  const s = Math.SQRT1_2;
  const list = { time_s: [0, 1], poses: [pose(0, 1, 0), pose(2, -s, -s)] };
  const [[x, , , qw, , , qz]] = posesThere(list, 0.5);
  isNear(x, 1);
  isNear(qw, Math.cos(Math.PI / 8));
  isNear(qz, Math.sin(Math.PI / 8));
  assert.equal(posesThere(list, 7)[0][0], 2);
  assert.equal(posesThere(list, -1)[0][0], 0);
  assert.equal(posesAt({ time_s: [], poses: [] }, 0), null);
});

test("the playback waits for what is not solved, and begins anew with the body and with the replay", () => {
  const plan = new PartialPlan(),
    clock = new PlaybackClock();
  assert.equal(clock.advance(0, plan, 2), 0);
  isNear(clock.advance(500, plan, 2), 0.5); // the path of the centre of mass
  plan.add({ attempt: 1, chunks: [START, frames("motion", 1, 0, 0.4)] });
  assert.equal(clock.advance(600, plan, 2), 0);
  isNear(clock.advance(800, plan, 2), 0.2);
  isNear(clock.advance(5000, plan, 2), 0.4);
  plan.add({ attempt: 1, chunks: [frames("motion", 1, 0.8, 2)] });
  isNear(clock.advance(5100, plan, 2), 0.5);
  plan.add({ attempt: 1, chunks: [frames("replay", undefined, 0, 0.3)] });
  assert.equal(clock.advance(5200, plan, 2), 0);
  isNear(clock.advance(9000, plan, 2), 0.3);
  plan.add({ attempt: 1, chunks: [frames("replay", undefined, 2)] });
  isNear(clock.advance(12000, plan, 2), 2);
  assert.equal(clock.advance(13001, plan, 2), 0); // again, after a pause
});

test("a run that begins anew takes the playback back", () => {
  const plan = new PartialPlan(),
    clock = new PlaybackClock();
  plan.add({ attempt: 1, chunks: [START, frames("motion", 1, 0, 2)] });
  clock.advance(0, plan, 2);
  isNear(clock.advance(1500, plan, 2), 1.5);
  plan.add({ attempt: 1, chunks: [frames("motion", 2, 0, 0.2)] });
  isNear(clock.advance(1600, plan, 2), 0.2);
});

test("the body, and then its replay, is drawn as soon as it is there, however slow pictures are", () => {
  const shown = [];
  const playback = new PlanPlayback({
    isAvailable: async () => true,
    show: (instant) => shown.push(instant?.ghost ? "replay" : instant?.poses ? "body" : "path"),
    drawn: () => new Promise(() => {}),
    report: () => {},
    reportCertificate: () => {},
  });
  playback.ends_s = [2];
  playback.play();
  playback.plan.add({ attempt: 1, chunks: [START, frames("motion", 1, 0, 0.1)] });
  playback.onParts();
  playback.plan.add({ attempt: 1, chunks: [frames("motion", 1, 0.2)] });
  playback.onParts();
  playback.plan.add({ attempt: 1, chunks: [frames("replay", undefined, 0, 0.1)] });
  playback.onParts();
  assert.deepEqual(shown, ["path", "body", "replay"]);
});

test("a certificate whose last parts were deleted with the end of the job is read from its result", async () => {
  const certificate = { passed: true, checks: [check("com_error_max", true), check("contact_drift_max", true)] };
  const answers = /** @type {Record<string, object>} */ ({
    "/api/v1/jobs/j/partial": { attempt: 1, next: "1.1", chunks: [] },
    "/api/v1/jobs/j/result": { summary: { certificate } },
  });
  const before = globalThis.fetch;
  globalThis.fetch = async (path) =>
    new Response(JSON.stringify(answers[String(path)]), { headers: { "content-type": "application/json" } });
  try {
    const plan = new PartialPlan(),
      said = [];
    plan.add({ attempt: 1, chunks: [{ kind: "certificate", checks: [check("com_error_max", true)] }] });
    await new PartialReader("j", plan, () => said.push(plan.certificateText)).readLast();
    assert.deepEqual(said, ["Certified: all 2 checks passed."]);
    answers["/api/v1/jobs/j/result"] = { summary: { certificate: null } };
    await new PartialReader("j", new PartialPlan(), () => said.push("no certificate")).readLast();
    assert.equal(said.length, 1);
  } finally {
    globalThis.fetch = before;
  }
});

test("a request while another one is on its way resolves after the parts that come last", async () => {
  const answers = [
    { attempt: 1, next: "1.1", chunks: [START] },
    {
      attempt: 1,
      next: "1.2",
      chunks: [{ kind: "certificate", checks: [check("com_error_max", true)], passed: true }],
    },
    { attempt: 1, next: "1.2", chunks: [] },
  ];
  const paths = [];
  const before = globalThis.fetch;
  globalThis.fetch = async (path) => {
    paths.push(String(path));
    await new Promise((resolve) => setTimeout(resolve, 5));
    return new Response(JSON.stringify(answers.shift()), { headers: { "content-type": "application/json" } });
  };
  try {
    const plan = new PartialPlan();
    const reader = new PartialReader("j", plan, () => {});
    reader.request();
    await reader.request();
    assert.equal(plan.certificateText, "Certified: all 1 checks passed.");
    assert.equal(paths.length, 2);
    await reader.request();
    assert.match(paths[2], /after=1\.2$/);
  } finally {
    globalThis.fetch = before;
  }
});
