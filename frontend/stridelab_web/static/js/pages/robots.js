// Robot pages: fills each card with the data of its robot, which the service has to load, and starts learning its reach.
import { call, onSubmit, openNewJob } from "../shared/api.js";

for (const card of document.querySelectorAll('[data-robot][data-available="true"]')) fillCard(card);

/** @param {PageElement} card */
async function fillCard(card) {
  const write = (/** @type {string} */ name, /** @type {string} */ text) => {
    card.querySelector(`[data-${name}]`).textContent = text;
  };
  try {
    const robot = await call("GET", `/robots/${card.dataset.robot}`);
    write("mass", `${robot.mass_kg.toFixed(1)} kg`);
    write("height", `${robot.com_height_m.toFixed(3)} m`);
    write("joints", String(robot.limits.length));
    write("densities", robot.measures.join(", ") || "not learned");
  } catch (error) {
    for (const name of ["mass", "height", "joints", "densities"]) write(name, "–");
    write("said", /** @type {Error} */ (error).message);
  }
}

const form = document.querySelector("form[data-learn]");
if (form) {
  onSubmit(form, (data) =>
    openNewJob("learn-reachability", {
      robot: form.dataset.learn,
      samples: Number(data.get("samples")),
      seed: Number(data.get("seed")),
      measure: data.get("measure"),
    }),
  );
}
