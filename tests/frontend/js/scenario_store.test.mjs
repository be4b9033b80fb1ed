import assert from "node:assert/strict";
import test, { beforeEach } from "node:test";
import {
  moveContact,
  setPoseNumber,
  ScenarioStore,
  scenarioFields,
} from "../../../frontend/stridelab_web/static/js/editor/scenario_store.js";
import { AHEAD, LEFT, RIGHT, walk } from "./scenario.mjs";

// A service with one scenario, which refuses a version that is not the stored one.
let stored, requests;
const session = new Map();

beforeEach(() => {
  stored = { ...walk(), id: "s1", owner: "me", updated_at: "v1" };
  requests = [];
  session.clear();
});
/** @type {any} */ (globalThis).sessionStorage = {
  getItem: (key) => session.get(key) ?? null,
  setItem: (key, value) => session.set(key, value),
  removeItem: (key) => session.delete(key),
};
/** @type {any} */ (globalThis).fetch = async (url, { method, headers, body }) => {
  requests.push(`${method} ${url}`);
  if (method === "PUT" && headers["If-Match"] !== JSON.stringify(stored.updated_at)) {
    return new Response(JSON.stringify({ title: "Changed", detail: "It was changed." }), { status: 412 });
  }
  if (method === "PUT") changeElsewhere(JSON.parse(body));
  return new Response(JSON.stringify(stored));
};
const changeElsewhere = (fields) => {
  stored = { ...stored, ...fields, updated_at: `v${Number(stored.updated_at.slice(1)) + 1}` };
};
const named = (name) => ({ ...scenarioFields(stored), name });

async function openStore() {
  const store = new ScenarioStore("s1");
  await store.read();
  return store;
}

test("a scenario is read without the fields of the service", async () => {
  const store = await openStore();
  assert.deepEqual(requests, ["GET /api/v1/scenarios/s1"]);
  assert.deepEqual(store.scenario.phases, walk().phases);
  assert.ok(!("owner" in store.scenario) && !("id" in store.scenario));
});

test("stored edits are undone and redone in order", async () => {
  const store = await openStore();
  await store.store(named("second"));
  await store.store(named("third"));
  assert.equal(await store.undo(), true);
  assert.equal(stored.name, "second");
  await store.undo();
  assert.equal(stored.name, "walk");
  assert.equal(await store.undo(), false);
  await store.redo();
  assert.equal(stored.name, "second");
});

test("a new edit ends what could be redone", async () => {
  const store = await openStore();
  await store.store(named("second"));
  await store.undo();
  await store.store(named("other"));
  assert.equal(await store.redo(), false);
  assert.equal(stored.name, "other");
});

test("a change elsewhere is noticed, is not overwritten, and can be undone", async () => {
  const store = await openStore();
  changeElsewhere({ name: "elsewhere" });
  await assert.rejects(store.store(named("mine")), { status: 412 });
  assert.equal(stored.name, "elsewhere");
  assert.equal(await store.read(), true);
  assert.equal(await store.read(), false);
  await store.undo();
  assert.equal(stored.name, "walk");
});

test("the history survives a reload unless the scenario was changed since", async () => {
  const store = await openStore();
  await store.store(named("second"));
  assert.equal((await openStore()).past.length, 1);
  changeElsewhere({ name: "elsewhere" });
  assert.equal((await openStore()).past.length, 0);
});

test("at most forty steps are kept", async () => {
  const store = await openStore();
  for (let k = 0; k < 45; k += 1) await store.store(named(`edit ${k}`));
  assert.equal(store.past.length, 40);
  assert.equal(store.past[0].name, "edit 4");
});

test("a touch is moved in its phases only", () => {
  const turned = [0, 0, 0, 1];
  const { phases } = moveContact(walk(), { effector: "left_foot", phases: [1, 1] }, [0.1, 0.2, 0.3], turned);
  assert.deepEqual(phases[0].contacts, [LEFT, RIGHT]);
  assert.deepEqual(phases[1].contacts, [
    { effector: "left_foot", position_m: [0.1, 0.2, 0.3], orientation_wxyz: turned },
  ]);
  assert.deepEqual(phases[2].contacts, [LEFT, AHEAD]);
});

test("a number of a pose is changed in all phases of a touch, and nothing else", () => {
  const touch = /** @type {any} */ ({ effector: "left_foot", phases: [1, 1] });
  const place = (/** @type {any} */ scenario) =>
    scenario.phases[1].contacts.find((/** @type {any} */ one) => one.effector === "left_foot");
  const before = place(walk());
  const moved = place(setPoseNumber(walk(), touch, "y", 0.42));
  assert.deepEqual(moved.position_m, [before.position_m[0], 0.42, before.position_m[2]]);
  assert.deepEqual(moved.orientation_wxyz, before.orientation_wxyz);
  const turned = place(setPoseNumber(setPoseNumber(walk(), touch, "yaw", 30), touch, "yaw", 90));
  assert.deepEqual(turned.position_m, before.position_m);
  for (const [k, value] of [Math.SQRT1_2, 0, 0, Math.SQRT1_2].entries())
    assert.ok(Math.abs(turned.orientation_wxyz[k] - value) < 1e-9);
});

test("an edit of a read-only scenario is stored as a copy, which can be undone", async () => {
  /** @type {string[]} */
  const opened = [];
  const href = "http://lab/view/?scenario=s1&phase=2";
  /** @type {any} */ (globalThis).location = { href, assign: (url) => opened.push(String(url)) };
  const store = new ScenarioStore("s1", true);
  await store.read();
  stored = { ...stored, id: "s2", name: "walk (copy)", phases: walk().phases.slice(1) }; // the answer of the service
  void store.store({ ...store.scenario, phases: walk().phases.slice(1) });
  await new Promise((done) => setTimeout(done));
  assert.deepEqual(requests, ["GET /api/v1/scenarios/s1", "POST /api/v1/scenarios"]);
  assert.deepEqual(opened, ["http://lab/view/?scenario=s2&phase=2"]);

  const copy = new ScenarioStore("s2");
  await copy.read();
  assert.equal(await copy.undo(), true);
  assert.deepEqual([stored.name, stored.phases], ["walk (copy)", walk().phases]);
});
