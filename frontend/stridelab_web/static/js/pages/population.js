// The form of a population study: recordings are chosen and assigned to subjects and groups.
import { onSubmit, openNewJob } from "../shared/api.js";
import { translate, translateCount } from "../shared/translate.js";

const form = document.querySelector("[data-study]");
const rows = [...form.querySelectorAll("tr[data-recording]")];
const all = form.querySelector("[data-all]");
const chosenRows = () => rows.filter((row) => row.querySelector("[name=chosen]").checked);

function showCount() {
  const chosen = chosenRows(),
    subjects = new Set(chosen.map((row) => row.querySelector("[name=subject]").value.trim()));
  form.querySelector("[data-count]").textContent = translate("%(recordings)s of %(people)s", {
    recordings: translateCount("%(num)s recording", "%(num)s recordings", chosen.length),
    people: translateCount("%(num)s person", "%(num)s people", subjects.size),
  });
  all.checked = chosen.length === rows.length;
  all.indeterminate = chosen.length > 0 && chosen.length < rows.length;
}

/** @param {PageElement} row @param {string} groupOfAll */
function subjectEntry(row, groupOfAll) {
  const text = (/** @type {string} */ name) => row.querySelector(`[name=${name}]`).value.trim();
  return {
    recording_id: row.dataset.recording,
    subject: text("subject") || null,
    group: text("group") || groupOfAll || null,
    height_m: text("height_m") === "" ? null : Number(text("height_m")),
  };
}

if (rows.length) {
  all.addEventListener("change", () => {
    for (const row of rows) row.querySelector("[name=chosen]").checked = all.checked;
    showCount();
  });
  form.addEventListener("change", (event) => event.target !== all && showCount());
  showCount();
  onSubmit(form, (data) => {
    const chosen = chosenRows();
    if (!chosen.length) return translate("Choose at least one recording.");
    const input = {
      recording_ids: chosen.map((row) => row.dataset.recording),
      method: data.get("method") || null,
      steps: data.get("steps"),
      pooled: data.has("pooled"),
      subjects: chosen.map((row) => subjectEntry(row, data.get("group-of-all").trim())),
    };
    return openNewJob("study-population", input, "/population");
  });
}
