// Scenario pages: plan, import, copy, delete.
import { call, onClick, onSubmit, openNewJob } from "../shared/api.js";
import { planningUrl, startPlan } from "../editor/planning_jobs.js";
import { translate } from "../shared/translate.js";
import { replayOf } from "./replay_options.js";

for (const form of document.querySelectorAll("form[data-plan]")) {
  const whole = form.elements.whole_body,
    replay = form.elements.replay,
    free = form.elements.free_durations,
    fastest = form.elements.fastest;
  whole?.addEventListener("change", () => {
    for (const option of [replay, fastest]) {
      option.disabled = !whole.checked;
      if (!whole.checked) option.checked = false;
    }
  });
  onSubmit(form, async (fields) => {
    const options = whole
      ? {
          whole_body: whole.checked,
          replay: replayOf(fields, replay.checked),
          free_durations: free.checked,
          fastest: fastest.checked,
        }
      : {};
    const job = await startPlan(form.dataset.plan, options);
    location.assign(planningUrl(form.dataset.plan, job.id));
    return translate("Started.");
  });
}

for (const form of document.querySelectorAll("form[data-sweep]")) {
  onSubmit(form, (fields) => {
    /** @type {Record<string, number[]>} */
    const vary = {};
    for (const k of ["1", "2"]) {
      if (fields.get(`field${k}`))
        vary[fields.get(`field${k}`)] = ["from", "to", "number"].map((name) => Number(fields.get(`${name}${k}`)));
    }
    const whole_body = form.elements.whole_body.checked;
    return openNewJob("sweep", { scenario_id: form.dataset.sweep, vary, whole_body });
  });
}

for (const form of document.querySelectorAll("form[data-basin]")) {
  onSubmit(form, (fields) => {
    const [speed_m_s, n, seed] = ["speed_m_s", "n", "seed"].map((name) => Number(fields.get(name)));
    return openNewJob("push-basin", { scenario_id: form.dataset.basin, speed_m_s, n, seed });
  });
}

const importForm = document.querySelector("form[data-import]");
importForm?.elements.file.addEventListener("change", async () => {
  const [file] = importForm.elements.file.files;
  const status = importForm.querySelector("[data-said]");
  if (!file) return;
  status.textContent = "…";
  try {
    location.assign(`/scenarios/${(await call("POST", "/scenarios", await readScenario(file))).id}`);
  } catch (error) {
    status.textContent = `${file.name}: ${/** @type {Error} */ (error).message}`;
  }
  importForm.reset();
});

/** @param {File} file */
async function readScenario(file) {
  let body;
  try {
    body = JSON.parse(await file.text());
  } catch {
    throw new Error("this is not JSON");
  }
  if (body === null || typeof body !== "object" || Array.isArray(body)) throw new Error("this is not a scenario");
  return body;
}

const status = document.querySelector("[data-said-copy]");
const copyButton = document.querySelector("[data-copy]");
onClick(copyButton, status, async () => {
  const original = await call("GET", `/scenarios/${copyButton.dataset.copy}`);
  const name = `${original.name} (copy)`.slice(0, 120);
  const copy = await call("POST", "/scenarios", { ...original, name });
  location.assign(`/scenarios/${copy.id}`);
});

const deleteButton = document.querySelector("[data-delete]");
deleteButton?.addEventListener("click", async () => {
  if (!confirm("Delete this scenario? Its plans stay.")) return;
  try {
    await call("DELETE", `/scenarios/${deleteButton.dataset.delete}`);
    location.assign("/scenarios");
  } catch (error) {
    status.textContent = /** @type {Error} */ (error).message;
  }
});
