import assert from "node:assert/strict";
import test from "node:test";

process.env.TZ = "Asia/Kolkata";
const { localiseTimes, localTime } = await import("../../../frontend/stridelab_web/static/js/shared/local_times.js");

test("a time in UTC is shown in the local zone", () => {
  assert.match(localTime("2026-11-23T06:54:12Z"), /^2026-11-23 12:24 (GMT\+5:30|IST)$/);
  assert.match(localTime("2026-12-31T20:05:00Z"), /^2027-01-01 01:35 /);
  assert.match(localTime("2026-03-04T05:06:07+02:00"), /^2026-03-04 08:36 /);
});

test("times of a page are replaced in place", () => {
  const time = { dateTime: "2026-11-23T06:54:12Z", textContent: "2026-11-23 06:54 UTC" };
  const node = { dataset: { atTime: time.dateTime }, textContent: "created 2026-11-23 06:54 UTC by an admin" };
  localiseTimes({ querySelectorAll: (selector) => (selector.startsWith("time") ? [time] : [node]) });
  assert.match(time.textContent, /^2026-11-23 12:24 /);
  assert.match(node.textContent, /^created 2026-11-23 12:24 (GMT\+5:30|IST) by an admin$/);
});
