// Subject pages: add, change and delete a subject, and assign recordings to it.
import { call, confirmDeletion, onClick, onSubmit } from "../shared/api.js";
import { translate } from "../shared/translate.js";

/** @param {string} text */
const parseNumber = (text) => (text === "" ? null : Number(text));
/** @param {FormData} data */
const subjectFields = (data) => ({
  name: data.get("name").trim() || null,
  sex: data.get("sex") || null,
  height_m: parseNumber(data.get("height_m")),
  mass_kg: parseNumber(data.get("mass_kg")),
  age_years: parseNumber(data.get("age_years")),
});

const addForm = document.querySelector("form[data-add]");
if (addForm) {
  onSubmit(addForm, async (data) => {
    location.assign(`/subjects/${(await call("POST", "/subjects", subjectFields(data))).subject_id}`);
    return translate("Added.");
  });
}

const subjectPage = document.querySelector("div[data-subject]");
if (subjectPage) {
  const id = subjectPage.dataset.subject,
    find = (/** @type {string} */ selector) => subjectPage.querySelector(selector);
  onSubmit(find("[data-change]"), async (data) => {
    await call("PATCH", `/subjects/${id}`, subjectFields(data));
    location.reload();
    return translate("Saved.");
  });

  if (find("[data-link]")) {
    onSubmit(find("[data-link]"), async (data) => {
      await call("PATCH", `/recordings/${data.get("recording")}`, { subject_id: id });
      location.reload();
      return translate("Saved.");
    });
  }

  onClick(find("[data-unlink]"), find("[data-said-unlink]"), async () => {
    const recordings = [...subjectPage.querySelectorAll("[name=recording]:checked")].map((box) => box.value);
    if (!recordings.length) throw new Error(translate("Choose recordings first."));
    for (const recording of recordings) await call("PATCH", `/recordings/${recording}`, { subject_id: null });
    location.reload();
  });

  confirmDeletion(`/subjects/${id}`, "/subjects");
}
