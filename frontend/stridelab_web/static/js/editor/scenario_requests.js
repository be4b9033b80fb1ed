// What is sent to store or to judge a scenario, the same with one of its touches elsewhere, and a copy of it.
import { call } from "../shared/api.js";

const NAMES = ["name", "description", "robot", "friction", "start_com_height_m", "terrain", "phases"];
const NAME_AT_MOST = 120;
export const FOUND = ": contacts found"; // ends the name of what the contact planner made
export const TIMED = ": durations chosen"; // and of a scenario with the durations of a plan

// Without what the service itself adds.
export const bodyOf = (stored) => Object.fromEntries(NAMES.map((name) => [name, stored[name]]));

// `body` with a touch at another place, in all phases in which it is there.
export function moved(body, touch, position_m, orientation_wxyz) {
  const [first, last] = touch.phases;
  const put = (contact) =>
    contact.effector === touch.effector ? { ...contact, position_m, orientation_wxyz } : contact;
  const phases = body.phases.map((phase, k) =>
    k < first || k > last ? phase : { ...phase, contacts: phase.contacts.map(put) },
  );
  return { ...body, phases };
}

// Stores `body` under its name with an ending, and opens it in the editor.
export async function openNew(body, ending) {
  const name = body.name.endsWith(ending) ? body.name : body.name.slice(0, NAME_AT_MOST - ending.length) + ending;
  const made = await call("POST", "/scenarios", { ...body, name });
  location.assign(`/view/?scenario=${encodeURIComponent(made.id)}`);
}
