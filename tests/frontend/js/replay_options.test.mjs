// What the form of a plan states about its replay: no disturbance is dropped without a word.
import assert from "node:assert/strict";
import test from "node:test";
import { replayOf } from "../../../frontend/stridelab_web/static/js/pages/replay_options.js";

const UNTOUCHED = { push_time_s: "", push_x_ns: "0", push_y_ns: "20", push_z_ns: "0", push_link: "", payload_kg: "0" };

function formWith(changes = {}) {
  const fields = new FormData();
  const values = { ...UNTOUCHED, replay_friction: "", delay_ms: "0", ...changes };
  for (const [name, value] of Object.entries(values)) fields.set(name, value);
  return fields;
}

test("without disturbances the replay is on or off", () => {
  assert.equal(replayOf(formWith(), true), true);
  assert.equal(replayOf(formWith(), false), false);
  assert.equal(replayOf(formWith({ push_y_ns: "0" }), false), false);
});

test("disturbances are those of the replay", () => {
  const push = { push_time_s: "1.5", push_x_ns: "10", push_link: " torso " };
  assert.deepEqual(replayOf(formWith({ ...push, payload_kg: "3", delay_ms: "4", estimated: "on" }), true), {
    pushes: [{ time_s: 1.5, impulse_ns: [10, 20, 0], link: "torso" }],
    payload_kg: 3,
    delay_s: 0.004,
    sensors: "estimated",
  });
  assert.deepEqual(replayOf(formWith({ replay_friction: "0.2" }), true), { friction: 0.2 });
});

for (const changes of [
  { push_time_s: "1" },
  { payload_kg: "3" },
  { replay_friction: "0.2" },
  { delay_ms: "4" },
  { estimated: "on" },
])
  test(`${Object.keys(changes)[0]} is refused without a replay`, () => {
    assert.throws(() => replayOf(formWith(changes), false), /Only a replay in physics can be disturbed/);
  });

for (const changes of [{ push_x_ns: "5" }, { push_y_ns: "30" }, { push_link: "torso" }])
  test(`a push with ${Object.keys(changes)[0]} and without its time is refused`, () => {
    assert.throws(() => replayOf(formWith(changes), true), /A push needs its time/);
  });
