// The forms of a recording's page: each sends only what it shows.
import { call, onSubmit, startJob } from "../shared/api.js";

const root = document.querySelector("[data-recording]");
// Said once: a reload, or a link that is kept, is about the recording alone.
if (document.querySelector("[data-known]")) history.replaceState(null, "", location.pathname);
const id = root.dataset.recording;
const find = (selector) => root.querySelector(selector);
// As the page came, whatever a browser has filled in since.
const givenIn = (field) =>
  field.defaultValue ?? [...field.options].find((option) => option.defaultSelected)?.value ?? "";
const number = (text) => (text === "" || text == null ? null : Number(text));

// Saving may change what the windows and warnings are, so the page is asked for anew and says that it was saved.
async function save(patch) {
  await call("PATCH", `/recordings/${id}`, patch);
  location.reload();
  return "Saved.";
}

// Only what was changed is sent: the rest goes on following the person, or the file.
onSubmit(find("[data-subject]"), () => {
  const changed = [...find("[data-subject]").querySelectorAll("input, select")].filter(
    (field) => field.value !== givenIn(field),
  );
  if (!changed.length) return "Nothing was changed.";
  return save({
    subject: Object.fromEntries(
      changed.map(({ name, value, type }) => [name, type === "number" ? number(value) : value || null]),
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
    const plates = {};
    for (const row of root.querySelectorAll("[data-plate]")) {
      plates[row.dataset.plate] = {
        use: row.querySelector("[name=use]").checked,
        threshold_n: number(row.querySelector("[name=threshold_n]").value),
      };
    }
    return save({ plates });
  });
}

onSubmit(find("[data-markers]"), (data) =>
  save({ marker_map: Object.fromEntries([...data].filter(([, label]) => label)) }),
);

const estimate = find("[data-estimate]");
// What a method does not use is neither shown nor sent.
const offer = (selector, used) => {
  for (const label of estimate.querySelectorAll(selector)) {
    label.hidden = !used;
    for (const field of label.querySelectorAll("input, select")) field.disabled = !used;
  }
};
// What is known to fail is not started: the buttons say why. "" is the best available method.
const refused = JSON.parse(estimate.dataset.refused),
  why = find("[data-why]");
const refuse = (button, method) => {
  button.disabled = method in refused;
  if (button.disabled) button.setAttribute("aria-describedby", why.id);
  else button.removeAttribute("aria-describedby");
};
const followRefusals = (method) => {
  refuse(estimate.querySelector("button.primary"), method);
  refuse(find("[data-wheel]"), method);
  refuse(find("[data-compare]"), "");
  why.textContent = refused[method] ?? refused[""] ?? "";
  why.hidden = !why.textContent;
};
const FILTERS = new Set(["", "complementary", "kalman", "rts"]);
const follow = () => {
  const method = estimate.method.value,
    chosen = FILTERS.has(method) ? estimate.cutoffs.value : "auto";
  offer("[data-latency]", estimate.latency.value === "number");
  followRefusals(method);
  offer("[data-of-filters]", FILTERS.has(method));
  offer("[data-cutoffs]", chosen === "numbers");
  offer("[data-of-smoother]", method === "smoother" || (method === "" && chosen === "auto"));
};
estimate.addEventListener("change", follow);
follow();
const smootherOf = (data) => {
  const plate_force_n = number(data.get("plate_force_n")),
    segment_momentum = data.get("momentum") === "segments";
  return plate_force_n === null && !segment_momentum ? null : { priors: { plate_force_n }, segment_momentum };
};
const inputOf = (data) => ({
  recording_id: id,
  method: data.get("method") || null,
  latency: data.get("latency") === "number" ? Number(data.get("latency_ms")) / 1000 : data.get("latency"),
  segment_table: data.get("segment_table"),
  cutoffs:
    data.get("cutoffs") === "numbers"
      ? [number(data.get("low_hz")), number(data.get("high_hz"))]
      : data.get("cutoffs") || "auto",
  smoother: smootherOf(data),
});
const start = async (kind, input) => {
  const job = await startJob(kind, input);
  location.assign(`/jobs/${job.id}`);
  return "Started.";
};
onSubmit(estimate, (data) => start("estimate-com", inputOf(data)));
const onPress = (selector, kind, chosen) =>
  find(selector).addEventListener("click", async (event) => {
    const said = estimate.querySelector("[data-said]"),
      button = event.currentTarget;
    button.disabled = true;
    try {
      said.textContent = await start(kind, chosen(inputOf(new FormData(estimate))));
    } catch (error) {
      said.textContent = error.message;
    } finally {
      button.disabled = false;
      followRefusals(estimate.method.value);
    }
  });
onPress("[data-compare]", "compare-estimators", (input) => ({ ...input, method: null }));
onPress("[data-wheel]", "fit-cycloid", (input) => input);

const dialog = find("[data-confirm]");
find("[data-no]").addEventListener("click", () => dialog.close());
find("[data-yes]").addEventListener("click", async () => {
  try {
    await call("DELETE", `/recordings/${id}`);
    location.assign("/recordings");
  } catch (error) {
    dialog.querySelector("[data-said]").textContent = error.message;
  }
});
document.querySelector("[data-delete]")?.addEventListener("click", () => dialog.showModal());
