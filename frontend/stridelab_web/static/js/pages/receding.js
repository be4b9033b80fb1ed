// The form of a receding-horizon plan; each row is a push.
import { removeRow } from "../shared/focus.js";
import { onSubmit, openNewJob } from "../shared/api.js";

const AXES = ["x", "y", "z"];
const form = document.querySelector("form[data-receding]");
const rows = form?.querySelector("[data-pushes]");

form?.querySelector("[data-add]").addEventListener("click", () => {
  const row = form.querySelector("template").content.firstElementChild.cloneNode(true);
  row.querySelector("[data-remove]").addEventListener("click", () => removeRow(row, form.querySelector("[data-add]")));
  rows.append(row);
  row.querySelector("input").focus();
});

/** @param {Element} row @param {string} name */
const inputNumber = (row, name) => row.querySelector(`[name=${name}]`).valueAsNumber;

if (form) {
  onSubmit(form, () =>
    openNewJob("plan-receding", {
      scenario_id: form.dataset.receding,
      horizon_s: form.elements.horizon_s.valueAsNumber,
      period_s: form.elements.period_s.valueAsNumber,
      pushes: [...rows.children].map((row) => ({
        time_s: inputNumber(row, "time_s"),
        velocity_m_s: AXES.map((axis) => inputNumber(row, axis)),
      })),
    }),
  );
}
