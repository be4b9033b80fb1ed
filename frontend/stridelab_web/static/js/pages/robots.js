// Robot pages: fills each card with the data of its robot, which the service has to load, and starts learning its reach.
import { call, onClick, onSubmit, openNewJob } from "../shared/api.js";

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

// Scales a bundled scene to the robot, stores it and opens it in the editor.
const scenes = document.querySelector("[data-scenes]");
for (const button of scenes?.querySelectorAll("[data-scene]") ?? [])
  onClick(button, scenes.querySelector("[data-said]"), async () => {
    const scaled = await call("POST", "/scenarios/scaled", {
      robot: scenes.dataset.scenes,
      scene: button.dataset.scene,
    });
    const { id } = await call("POST", "/scenarios", scaled);
    location.assign(`/view/?scenario=${encodeURIComponent(id)}`);
  });
