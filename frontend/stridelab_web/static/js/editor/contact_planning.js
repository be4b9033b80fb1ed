// "Find contacts": from the stance of a scenario's first phase to that of its last, as a new scenario.
import { call, startJob } from "../shared/api.js";
import { offerJob } from "./motion_planning.js";
import { FOUND, openNew } from "./scenario_requests.js";

const FEET = ["left_foot", "right_foot"];

export function offerContacts(root, scenarioId, before) {
  let name = "";
  const start = async () => {
    const stored = await call("GET", `/scenarios/${scenarioId}`);
    name = stored.name;
    return startJob("plan-contacts", taskOf(stored));
  };
  const onSuccess = async (job) => {
    const result = await call("GET", `/jobs/${job.id}/result`);
    await openNew({ ...result.summary.scenario, name }, FOUND);
  };
  offerJob(root, "find", { start, before, onSuccess });
}

function taskOf({ name, robot, terrain, friction, phases }) {
  if (!phases.length) throw new Error("This scenario has no phases: there is no start and no goal.");
  const ends = { start: phases[0], goal: phases.at(-1) };
  for (const [end, { contacts }] of Object.entries(ends)) {
    const missing = FEET.filter((foot) => !contacts.some((contact) => contact.effector === foot));
    const phase = end === "start" ? "first" : "last";
    if (missing.length)
      throw new Error(
        `A ${end} needs both feet, and the ${phase} phase lacks the ${missing.map((foot) => foot.replace("_", " ")).join(" and the ")}.`,
      );
  }
  const [start, goal] = Object.values(ends).map(({ contacts }) => ({ contacts }));
  return { name, robot, terrain, friction, start, goal };
}
