// Who walked in which recording, and the button that starts the study of all who are chosen.
import { onSubmit, startJob } from "../shared/api.js";

const form = document.querySelector("[data-study]");
const rows = [...form.querySelectorAll("tr[data-recording]")];
const all = form.querySelector("[data-all]");
const chosen = () => rows.filter((row) => row.querySelector("[name=chosen]").checked);

const counted = (n, one, many) => `${n} ${n === 1 ? one : many}`;

function count() {
  const found = chosen(),
    people = new Set(found.map((row) => row.querySelector("[name=subject]").value.trim()));
  form.querySelector("[data-count]").textContent =
    `${counted(found.length, "recording", "recordings")} of ${counted(people.size, "person", "people")}`;
  all.checked = found.length === rows.length;
  all.indeterminate = found.length > 0 && found.length < rows.length;
}

function personOf(row, groupOfAll) {
  const text = (name) => row.querySelector(`[name=${name}]`).value.trim();
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
    count();
  });
  form.addEventListener("change", (event) => event.target !== all && count());
  count();
  onSubmit(form, async (data) => {
    const found = chosen();
    if (!found.length) return "Choose at least one recording.";
    const job = await startJob("study-population", {
      recording_ids: found.map((row) => row.dataset.recording),
      method: data.get("method") || null,
      steps: data.get("steps"),
      pooled: data.has("pooled"),
      subjects: found.map((row) => personOf(row, data.get("group-of-all").trim())),
    });
    location.assign(`/population/${job.id}`);
    return "Started.";
  });
}
