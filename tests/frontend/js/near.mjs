import assert from "node:assert/strict";

// Asserts that two lists of numbers agree within a tolerance.
export function assertNear(actual, expected, tolerance = 1e-12) {
  assert.equal(actual.length, expected.length);
  for (const [k, value] of expected.entries())
    assert.ok(Math.abs(actual[k] - value) <= tolerance, `[${k}]: ${actual[k]} instead of ${value}`);
}
