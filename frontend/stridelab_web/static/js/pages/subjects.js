// Subjects: add one, change one, say which recordings are of that person, delete one.
import { call, onSubmit } from "../shared/api.js";

const number = (text) => (text === "" ? null : Number(text));
const fieldsOf = (data) => ({
  name: data.get("name").trim() || null,
  sex: data.get("sex") || null,
  height_m: number(data.get("height_m")),
  mass_kg: number(data.get("mass_kg")),
  age_years: number(data.get("age_years")),
});

const adding = document.querySelector("form[data-add]");
if (adding) {
  onSubmit(adding, async (data) => {
    location.assign(`/subjects/${(await call("POST", "/subjects", fieldsOf(data))).subject_id}`);
    return "Added.";
  });
}

const one = document.querySelector("div[data-subject]");
if (one) {
  const id = one.dataset.subject,
    find = (selector) => one.querySelector(selector);
  onSubmit(find("[data-change]"), async (data) => {
    await call("PATCH", `/subjects/${id}`, fieldsOf(data));
    location.reload();
    return "Saved.";
  });

  if (find("[data-link]")) {
    onSubmit(find("[data-link]"), async (data) => {
      await call("PATCH", `/recordings/${data.get("recording")}`, { subject_id: id });
      location.reload();
      return "Saved.";
    });
  }

  find("[data-unlink]")?.addEventListener("click", async () => {
    const chosen = [...one.querySelectorAll("[name=recording]:checked")].map((box) => box.value);
    const said = find("[data-said-unlink]");
    if (!chosen.length) {
      said.textContent = "Choose recordings first.";
      return;
    }
    try {
      for (const recording of chosen) await call("PATCH", `/recordings/${recording}`, { subject_id: null });
      location.reload();
    } catch (error) {
      said.textContent = error.message;
    }
  });

  const dialog = find("[data-confirm]");
  document.querySelector("[data-delete]").addEventListener("click", () => dialog.showModal());
  find("[data-no]").addEventListener("click", () => dialog.close());
  find("[data-yes]").addEventListener("click", async () => {
    try {
      await call("DELETE", `/subjects/${id}`);
      location.assign("/subjects");
    } catch (error) {
      find("[data-said-delete]").textContent = error.message;
    }
  });
}
