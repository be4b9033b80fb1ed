// The forms of the page of a recording; each sends only its own fields.
import { call, confirmDeletion, onSubmit, openNewJob } from "../shared/api.js";
import { setActive } from "../shared/focus.js";
import { setUpMarkerNames } from "./marker_names.js";
import { pageLanguage, translate, translateServed } from "../shared/translate.js";

const root = document.querySelector("[data-recording]");
// Removes the notice's query from the address, so that a reload does not repeat the notice.
if (document.querySelector("[data-known]")) history.replaceState(null, "", location.pathname);
const id = root.dataset.recording;
const find = (/** @type {string} */ selector) => root.querySelector(selector);
// The value of a field as the page was loaded, without what the browser restored.
const initialValue = (/** @type {PageElement} */ field) =>
  field.defaultValue ?? [...field.options].find((option) => option.defaultSelected)?.value ?? "";
const parseNumber = (/** @type {string} */ text) => (text === "" || text == null ? null : Number(text));

// Saves a change and reloads the page: windows and warnings may depend on it.
/** @param {object} patch */
async function save(patch) {
  await call("PATCH", `/recordings/${id}`, patch);
  location.reload();
  return translate("Saved.");
}

// Sends only changed fields: the others keep following the subject or the file.
onSubmit(find("[data-subject]"), () => {
  const changed = [...find("[data-subject]").querySelectorAll("input, select")].filter(
    (field) => field.value !== initialValue(field),
  );
  if (!changed.length) return translate("Nothing was changed.");
  return save({
    subject: Object.fromEntries(
      changed.map(({ name, value, type }) => [name, type === "number" ? parseNumber(value) : value || null]),
    ),
  });
});
const massButton = find("[data-mass]");
massButton?.addEventListener("click", () => {
  find("[name=mass_kg]").value = massButton.dataset.mass;
});

onSubmit(find("[data-session]"), (data) => save({ session_id: data.get("session_id").trim() || null }));
onSubmit(find("[data-static]"), (data) => save({ static_recording_id: data.get("static_recording_id") || null }));

if (find("[data-plates]")) {
  onSubmit(find("[data-plates]"), () => {
    /** @type {Record<string, object>} */
    const plates = {};
    for (const row of root.querySelectorAll("[data-plate]")) {
      const offset_mm = [...row.querySelectorAll("[name=moment_offset_mm]")].map((field) => parseNumber(field.value));
      plates[row.dataset.plate] = {
        use: row.querySelector("[name=use]").checked,
        threshold_n: parseNumber(row.querySelector("[name=threshold_n]").value),
        belt_speed_m_s: parseNumber(row.querySelector("[name=belt_speed_m_s]").value),
        moment_offset_m: offset_mm.every((mm) => mm === null) ? null : offset_mm.map((mm) => (mm ?? 0) / 1000),
      };
    }
    return save({ plates });
  });
}

setUpMarkerNames(root, id, save);

const estimate = /** @type {any} */ (find("[data-estimate]")); // a form, whose fields are its properties
// Hides and disables the fields that a method does not use.
const enableFields = (/** @type {string} */ selector, /** @type {boolean} */ used) => {
  for (const label of estimate.querySelectorAll(selector)) {
    label.hidden = !used;
    for (const field of label.querySelectorAll("input, select")) field.disabled = !used;
  }
};
// Disables the buttons of jobs that would fail, with the reason, by method; "" is the best available method.
const refusals = JSON.parse(estimate.dataset.refused),
  refusalText = find("[data-why]");
const setRefusal = (/** @type {PageElement} */ button, /** @type {string} */ method) => {
  button.disabled = method in refusals;
  if (button.disabled) button.setAttribute("aria-describedby", refusalText.id);
  else button.removeAttribute("aria-describedby");
};
const showRefusals = (/** @type {string} */ method) => {
  setRefusal(estimate.querySelector("button.primary"), method);
  setRefusal(find("[data-wheel]"), method);
  setRefusal(find("[data-compare]"), "");
  for (const name of ["measures", "report", "imitate"]) setRefusal(find(`[data-${name}]`), method || "geometry"); // else markers alone
  refusalText.textContent = translateServed(refusals[method] ?? refusals[""] ?? "");
  refusalText.hidden = !refusalText.textContent;
};
const FILTERS = new Set(["", "complementary", "kalman", "rts"]);
const updateForm = () => {
  const method = estimate.method.value,
    cutoffs = FILTERS.has(method) ? estimate.cutoffs.value : "auto";
  enableFields("[data-latency]", estimate.latency.value === "number");
  showRefusals(method);
  enableFields("[data-of-filters]", FILTERS.has(method));
  enableFields("[data-cutoffs]", cutoffs === "numbers");
  enableFields("[data-of-smoother]", method === "smoother" || (method === "" && cutoffs === "auto"));
};
estimate.addEventListener("change", updateForm);
updateForm();
const smootherOptions = (/** @type {FormData} */ data) => {
  const plate_force_n = parseNumber(data.get("plate_force_n")),
    segment_momentum = data.get("momentum") === "segments";
  return plate_force_n === null && !segment_momentum ? null : { priors: { plate_force_n }, segment_momentum };
};
const jobInput = (/** @type {FormData} */ data) => ({
  recording_id: id,
  method: data.get("method") || null,
  latency: data.get("latency") === "number" ? Number(data.get("latency_ms")) / 1000 : data.get("latency"),
  segment_table: data.get("segment_table"),
  cutoffs:
    data.get("cutoffs") === "numbers"
      ? [parseNumber(data.get("low_hz")), parseNumber(data.get("high_hz"))]
      : data.get("cutoffs") || "auto",
  smoother: smootherOptions(data),
});
onSubmit(estimate, (data) => openNewJob("estimate-com", jobInput(data)));
const startOnClick = (
  /** @type {string} */ selector,
  /** @type {string} */ kind,
  /** @type {(input: any, button: PageElement) => object} */ adapt,
) => {
  for (const button of root.querySelectorAll(selector))
    button.addEventListener("click", async () => {
      const status = button.parentElement.querySelector("[data-said]");
      setActive(button, false);
      try {
        status.textContent = await openNewJob(kind, adapt(jobInput(new FormData(estimate)), button));
      } catch (error) {
        status.textContent = /** @type {Error} */ (error).message;
      } finally {
        setActive(button, true);
        showRefusals(estimate.method.value);
      }
    });
};
startOnClick("[data-compare]", "compare-estimators", (input) => ({ ...input, method: null }));
startOnClick("[data-wheel]", "fit-cycloid", (input) => input);
startOnClick("[data-measures]", "gait-measures", ({ method }) => ({ recording_ids: [id], method }));
const inPageLanguage = (/** @type {object} */ input) => ({ ...input, language: pageLanguage() });
startOnClick("[data-gait]", "gait-report", (_input, button) =>
  inPageLanguage({ recording_ids: button.dataset.gait.split(" ") }),
);
startOnClick("[data-imitate]", "imitate", (input) => ({ ...input, robot: estimate.robot.value }));
startOnClick("[data-report]", "gait-report", ({ method }) => inPageLanguage({ recording_ids: [id], method }));
const sessionWalks = () => ({ recording_ids: find("[data-session-measures]").dataset.sessionMeasures.split(" ") });
startOnClick("[data-session-measures]", "gait-measures", sessionWalks);
startOnClick("[data-session-report]", "gait-report", () => inPageLanguage(sessionWalks()));

onSubmit(find("[data-gait-report]"), (data) => {
  /** @type {any} */
  const input = { recording_ids: (data.get("recordings") || id).split(" ") };
  if (input.recording_ids.length === 1) input.method = estimate.method.value || null;
  if (data.get("title").trim()) input.title = data.get("title").trim();
  for (const row of root.querySelectorAll("[data-group]")) {
    const use = row.querySelector("select").value;
    if (use) input[use] = [...(input[use] ?? []), ...row.dataset.group.split(" ")];
  }
  return openNewJob("gait-report", inPageLanguage(input));
});

confirmDeletion(`/recordings/${id}`, "/recordings");
