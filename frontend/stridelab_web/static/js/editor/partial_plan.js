// What a running plan has computed so far: frames of the body, checks of the certificate, frames of the replay.
import { call } from "../shared/api.js";
import { counted } from "../shared/plurals.js";

const MANY = 20; // parts in one answer

/** @typedef {{ time_s: number[], poses: number[][][] }} FrameList */

export class PartialPlan {
  constructor() {
    this.clear();
  }

  clear() {
    /** @type {number} */
    this.attempt = 0;
    /** @type {string[]} */
    this.links = [];
    this.duration_s = 0;
    /** @type {number[]} */
    this.phaseEnds_s = [];
    this.run = 0;
    /** @type {FrameList} */
    this.motion = { time_s: [], poses: [] };
    /** @type {FrameList} */
    this.replay = { time_s: [], poses: [] };
    /** @type {any[]} */
    this.checks = [];
    /** @type {boolean | null} */
    this.passed = null;
  }

  // Adds the chunks of an answer of `/jobs/{id}/partial`; another attempt begins anew.
  /** @param {{ attempt: number, chunks: any[] }} answer */
  add({ attempt, chunks }) {
    if (attempt !== this.attempt) {
      this.clear();
      this.attempt = attempt;
    }
    for (const chunk of chunks) {
      if (chunk.kind === "plan")
        Object.assign(this, {
          links: chunk.links,
          duration_s: chunk.duration_s,
          phaseEnds_s: chunk.phase_ends_s,
        });
      else if (chunk.kind === "motion") {
        if (chunk.run !== this.run) this.motion = { time_s: [], poses: [] };
        this.run = chunk.run;
        append(this.motion, chunk);
      } else if (chunk.kind === "replay") append(this.replay, chunk);
      else if (chunk.kind === "certificate") {
        this.checks.push(...chunk.checks);
        this.passed = chunk.passed ?? this.passed;
      }
    }
  }

  // A sentence about the certificate: empty before its first check.
  get certificateText() {
    if (!this.checks.length) return "";
    const failed = this.checks.filter((check) => !check.passed);
    const names = failed.map((check) => check.name.replaceAll("_", " ")).join(", ");
    if (this.passed) return `Certified: all ${this.checks.length} checks passed.`;
    if (this.passed === false) return `Not certified: ${names}.`;
    const passed = counted(this.checks.length - failed.length, "check");
    return `Certificate so far: ${passed} passed${failed.length ? `; failed: ${names}` : ""}.`;
  }
}

/** @param {FrameList} list @param {FrameList} more */
function append(list, more) {
  list.time_s.push(...more.time_s);
  list.poses.push(...more.poses);
}

// The poses of all links at a time within the frames: positions between two frames are linear, rotations normalised.
/** @param {FrameList} frames @param {number} t_s @returns {number[][] | null} */
export function posesAt({ time_s, poses }, t_s) {
  if (!time_s.length) return null;
  const k = time_s.findIndex((t) => t >= t_s);
  if (k < 0) return poses[poses.length - 1];
  if (k === 0) return poses[0];
  const share = (t_s - time_s[k - 1]) / (time_s[k] - time_s[k - 1]);
  return poses[k - 1].map((from, link) => between(from, poses[k][link], share));
}

/** @param {number[]} from @param {number[]} to @param {number} share */
function between(from, to, share) {
  const sign = from.slice(3).reduce((sum, x, i) => sum + x * to[3 + i], 0) < 0 ? -1 : 1;
  const mixed = from.map((x, i) => (1 - share) * x + share * (i < 3 ? 1 : sign) * to[i]);
  const norm = Math.hypot(...mixed.slice(3));
  return mixed.map((x, i) => (i < 3 ? x : x / norm));
}

// Reads the parts of a job at each call of `request`: one request at a time.
export class PartialReader {
  // `onParts()` is called when something was added to `plan`.
  /** @param {string} jobId @param {PartialPlan} plan @param {() => void} onParts */
  constructor(jobId, plan, onParts) {
    this.jobPath = `/jobs/${encodeURIComponent(jobId)}`;
    this.path = `${this.jobPath}/partial`;
    this.plan = plan;
    this.onParts = onParts;
    this.cursor = "";
    this.isRequested = this.isStopped = false;
    /** @type {Promise<void> | null} */
    this.reading = null;
  }

  // Resolves when nothing is left to read.
  request() {
    this.isRequested = true;
    this.reading ??= this.readAll().finally(() => {
      this.reading = null;
    });
    return this.reading;
  }

  async readAll() {
    while (this.isRequested && !this.isStopped) {
      this.isRequested = false;
      const answer = await call("GET", `${this.path}${this.cursor && `?after=${this.cursor}`}`).catch(() => null);
      if (this.isStopped || !answer) return; // a lost answer is read again after the next event
      this.cursor = answer.next;
      if (!answer.chunks.length) continue;
      this.plan.add(answer);
      this.onParts();
      if (answer.chunks.length >= MANY) this.isRequested = true; // there may be more than one answer holds
    }
  }

  // Reads what is left of a job that has succeeded. Its parts are deleted with its end: where the last ones were not read in
  // time, the certificate is that of the result.
  async readLast() {
    await this.request();
    if (this.plan.passed !== null || this.isStopped) return;
    const result = await call("GET", `${this.jobPath}/result`).catch(() => null);
    const certificate = result?.summary.certificate;
    if (this.isStopped || !certificate) return;
    Object.assign(this.plan, { checks: certificate.checks, passed: certificate.passed });
    this.onParts();
  }

  stop() {
    this.isStopped = true;
  }
}
