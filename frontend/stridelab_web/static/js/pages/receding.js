// The form that has a scenario walked with a receding horizon: pushes are added and taken away row by row.
import { onSubmit, startJob } from "../shared/api.js";

const AXES = ["x", "y", "z"];
const form = document.querySelector("form[data-receding]");
const rows = form?.querySelector("[data-pushes]");

form?.querySelector("[data-add]").addEventListener("click", () => {
  const row = form.querySelector("template").content.firstElementChild.cloneNode(true);
  row.querySelector("[data-remove]").addEventListener("click", () => row.remove());
  rows.append(row);
  row.querySelector("input").focus();
});

const number = (row, name) => row.querySelector(`[name=${name}]`).valueAsNumber;

if (form) {
  onSubmit(form, async () => {
    const job = await startJob("plan-receding", {
      scenario_id: form.dataset.receding,
      horizon_s: form.elements.horizon_s.valueAsNumber,
      period_s: form.elements.period_s.valueAsNumber,
      pushes: [...rows.children].map((row) => ({
        time_s: number(row, "time_s"),
        velocity_m_s: AXES.map((axis) => number(row, axis)),
      })),
    });
    location.assign(`/jobs/${job.id}`);
    return "started";
  });
}
