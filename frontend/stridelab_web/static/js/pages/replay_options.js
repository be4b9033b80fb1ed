// What the form of a plan states about the replay in physics.
import { translate } from "../shared/translate.js";

const PUSHES = { push_x_ns: 0, push_y_ns: 20, push_z_ns: 0 }; // N s, as the form proposes them

// The field `replay` of a plan: false, true, or the disturbances. Throws where they would be dropped: without a replay, or
// a push without its time.
/** @param {FormData} fields @param {boolean} isReplayed */
export function replayOf(fields, isReplayed) {
  const stated = statedOptions(fields);
  if (!stated) return isReplayed;
  if (isReplayed) return stated;
  throw new Error(translate("Only a replay in physics can be disturbed: choose it, or clear the disturbances."));
}

/** @param {FormData} fields */
function statedOptions(fields) {
  const number = (/** @type {string} */ name) => Number(fields.get(name) || 0);
  /** @type {Record<string, unknown>} */
  const options = {};
  const link = String(fields.get("push_link") ?? "").trim() || null;
  if (fields.get("push_time_s")) {
    const impulse_ns = Object.keys(PUSHES).map(number);
    options.pushes = [{ time_s: number("push_time_s"), impulse_ns, link }];
  } else if (link || Object.entries(PUSHES).some(([name, usual]) => ![0, usual].includes(number(name)))) {
    throw new Error(translate("A push needs its time: state it, or clear the push."));
  }
  if (number("payload_kg")) options.payload_kg = number("payload_kg");
  if (fields.get("replay_friction")) options.friction = number("replay_friction");
  if (number("delay_ms")) options.delay_s = number("delay_ms") / 1000;
  if (fields.get("estimated")) options.sensors = "estimated";
  return Object.keys(options).length ? options : null;
}
