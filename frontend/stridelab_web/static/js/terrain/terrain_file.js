// The page "Terrain from a file": the surfaces that the service finds in a file, start and goal on them, then contacts, and on
// request the motion.
import { call } from "../shared/api.js";
import { createElement, smallButton } from "../shared/elements.js";
import { pageLanguage, translate, translateCount, translateServed } from "../shared/translate.js";
import { bindTaskButton, planningUrl, startPlan } from "../editor/planning_jobs.js";
import { crossingAdvice, otherUpAxis, refusalText, unitsThatFit } from "./terrain_advice.js";
import { drawPlaces, drawTerrain } from "./terrain_drawing.js";
import { facesOf, heightAt, heightRange, stairsText } from "./terrain_plan.js";

const NAME_LENGTH = 100;
const UNPROCESSABLE = 422; // the fault of such a refusal is the file, whose name stands before the sentence
const IMAGE_FIELDS = ["cell_m", "height_range_m"]; // of a PNG
const ENDS = /** @type {const} */ (["start", "goal"]);

const form = /** @type {any} */ (document.querySelector("form[data-terrain]"));
const part = (/** @type {string} */ name) => form.querySelector(`[data-${name}]`);
const [zone, status, offers, found, summary, remarks, svg, placed] = [
  "drop",
  "file-said",
  "offers",
  "found",
  "summary",
  "remarks",
  "plan-view",
  "placed",
].map(part);
const picker = form.elements.file;

/** @type {File | null} */
let file = null;
/** @type {import("./terrain_plan.js").ReadTerrain | null} */
let read = null;
/** @type {import("./terrain_plan.js").Face[]} */
let faces = [];
/** @type {import("./terrain_plan.js").Layout | null} */
let layout = null;
let turn = 0;

form.addEventListener("submit", (/** @type {Event} */ event) => event.preventDefault());
picker.addEventListener("change", takePicked);
for (const name of ["dragenter", "dragover"]) {
  zone.addEventListener(name, (/** @type {Event} */ event) => {
    event.preventDefault();
    zone.classList.add("over");
  });
}
zone.addEventListener("dragleave", (/** @type {DragEvent} */ event) => {
  if (!zone.contains(event.relatedTarget)) zone.classList.remove("over");
});
zone.addEventListener("drop", (/** @type {DragEvent} */ event) => {
  event.preventDefault();
  zone.classList.remove("over");
  const dropped = event.dataTransfer?.files[0];
  if (dropped) chooseFile(dropped);
});
for (const name of ["unit", "up", ...IMAGE_FIELDS]) form.elements[name].addEventListener("change", () => readFile());
svg.addEventListener("click", placeEnd);
for (const end of ENDS)
  for (const axis of ["x", "y"]) form.elements[`${end}_${axis}`].addEventListener("input", showPlaces);
new ResizeObserver(() => drawPlan()).observe(svg);

bindTaskButton(form, "plan", task, async (stored) => {
  const job = await startPlan(stored.id);
  location.assign(planningUrl(stored.id, job.id));
});
bindTaskButton(form, "place", task, (stored) => location.assign(`/view/?scenario=${stored.id}`));

takePicked(); // a file may be chosen before this script has come

function takePicked() {
  if (picker.files[0]) chooseFile(picker.files[0]);
  picker.value = "";
}

/** @param {File} chosen */
function chooseFile(chosen) {
  file = chosen;
  form.elements.name.value = chosen.name.replace(/\.[^.]*$/, "").slice(0, NAME_LENGTH);
  for (const end of ENDS) setPlace(end, null);
  for (const label of form.querySelectorAll("[data-image]")) label.hidden = !/\.png$/i.test(chosen.name);
  readFile();
}

// Sends the file and shows its terrain; an answer that a later one has overtaken is dropped.
async function readFile() {
  if (!file) return;
  const own = ++turn,
    { name } = file,
    unit = form.elements.unit.value;
  read = null;
  found.hidden = true;
  offers.replaceChildren();
  status.className = "";
  status.textContent = translate("Reading %(file)s…", { file: name });
  const body = new FormData();
  body.append("file", file);
  body.append("unit", unit);
  body.append("up", form.elements.up.value);
  if (/\.png$/i.test(name)) for (const field of IMAGE_FIELDS) body.append(field, form.elements[field].value);
  try {
    const answer = await call("POST", "/terrains", body);
    if (own === turn) show(answer, name);
  } catch (error) {
    if (own === turn) showRefusal(error, name, unit);
  }
}

/** @param {import("./terrain_plan.js").ReadTerrain} answer @param {string} name */
function show(answer, name) {
  read = answer;
  faces = facesOf(answer.terrain);
  status.textContent = name;
  const [low, high] = heightRange(faces).map((z) => z.toFixed(2));
  const counted = translateCount("%(num)s surface", "%(num)s surfaces", answer.terrain.length);
  summary.textContent = translate("%(surfaces)s, %(low)s to %(high)s m high.", { surfaces: counted, low, high });
  const rails = answer.terrain.filter(({ kind }) => kind === "rail").map((rail) => rail.name);
  const lines = answer.stairs.map((flight, k) => stairsText(flight, k + 1));
  if (rails.length) lines.push(translate("Rails: %(names)s", { names: rails.join(", ") }));
  part("named").replaceChildren(...lines.map((line) => createElement("li", {}, line)));
  part("named").hidden = !lines.length;
  remarks.replaceChildren(...answer.remarks.map(remarkItem));
  remarks.hidden = !answer.remarks.length;
  part("lowest").textContent = `${low} m`;
  part("highest").textContent = `${high} m`;
  part("wall-key").hidden = faces.every(({ walkable }) => walkable);
  part("rail-key").hidden = !rails.length;
  found.hidden = false;
  drawPlan();
}

// A remark of the service; in English if it has no translation.
/** @param {string} remark */
function remarkItem(remark) {
  const text = translateServed(remark);
  return createElement("li", { lang: text === remark ? "en" : pageLanguage() }, text);
}

// Says why the file was refused, and offers what may help.
/** @param {any} error @param {string} name @param {string} unit */
function showRefusal(error, name, unit) {
  const code = error.problem?.code ?? "";
  status.className = "wrong";
  const { detail } = error.problem ?? {};
  let text = error.status === UNPROCESSABLE && detail ? refusalText(code, detail) : error.message;
  const units = unitsThatFit(detail ?? "", unit);
  if (units.length) text = translate("The size of this terrain does not fit its unit.");
  status.textContent = text.includes(name) ? text : `${name}: ${text}`;
  const buttons = units.map(({ unit: other, width_m }) => {
    const [option] = [...form.elements.unit.options].filter(({ value }) => value === other);
    const text = translate("Read it in %(unit)s: %(width)s m wide", { unit: option.text, width: width_m.toFixed(1) });
    return offerChoice(text, "unit", other);
  });
  if (code === "terrain-without-surfaces") {
    const up = otherUpAxis(name, form.elements.up.value);
    buttons.push(offerChoice(translate("Read it with %(axis)s up", { axis: up.slice(1) }), "up", up));
  }
  offers.replaceChildren(...buttons);
}

/** @param {string} text @param {string} field @param {string} value */
function offerChoice(text, field, value) {
  const button = smallButton(text);
  button.addEventListener("click", () => {
    form.elements[field].value = value;
    form.elements[field].focus();
    readFile();
  });
  return button;
}

function drawPlan() {
  if (!read || found.hidden) return;
  layout = drawTerrain(svg, read);
  showPlaces();
}

/** @param {PointerEvent} event */
function placeEnd(event) {
  if (!layout) return;
  const { left, top, width } = svg.getBoundingClientRect(),
    units_per_px = layout.width / width;
  const place = layout
    .toMetres((event.clientX - left) * units_per_px, (event.clientY - top) * units_per_px)
    .map((value) => Number(value.toFixed(2)));
  if (heightAt(faces, place[0], place[1]) === null) {
    placed.textContent = translate("There is no surface at (%(x)s, %(y)s) m.", { x: place[0], y: place[1] });
    return;
  }
  const end = form.elements.end.value;
  setPlace(end, place);
  if (end === "start" && !placeOf("goal")) form.elements.end.value = "goal";
  showPlaces();
}

/** @param {"start" | "goal"} end @param {number[] | null} place */
function setPlace(end, place) {
  ["x", "y"].forEach((axis, k) => {
    form.elements[`${end}_${axis}`].value = place ? String(place[k]) : "";
  });
  if (!place) form.elements.end.value = "start";
}

/** @param {"start" | "goal"} end @returns {number[] | null} */
function placeOf(end) {
  const place = ["x", "y"].map((axis) => form.elements[`${end}_${axis}`].valueAsNumber);
  return place.every(Number.isFinite) ? place : null;
}

const TITLES = { start: () => translate("Start point"), goal: () => translate("Goal point") };

function showPlaces() {
  if (!layout) return;
  const places = { start: placeOf("start"), goal: placeOf("goal") };
  drawPlaces(svg, layout, places);
  placed.textContent = ENDS.map((end) => {
    const place = places[end],
      name = TITLES[end]();
    if (!place) return translate("%(end)s: not chosen.", { end: name });
    const height = heightAt(faces, place[0], place[1]);
    return height === null
      ? translate("%(end)s: there is no surface.", { end: name })
      : translate("%(end)s: %(height)s m high.", { end: name, height: height.toFixed(2) });
  }).join(" ");
}

// The task of the contact planner. Throws a sentence that says what is missing.
async function task() {
  if (!read) throw new Error(translate("Choose a file with a terrain first."));
  for (const end of ENDS) {
    const missing = end === "start" ? translate("Choose the start first.") : translate("Choose the goal first.");
    if (!placeOf(end)) throw new Error(missing);
  }
  const friction = form.elements.friction;
  if (!friction.validity.valid) {
    const range = { least: friction.min, most: friction.max };
    throw new Error(translate("Friction: a number from %(least)s to %(most)s.", range));
  }
  const body = {
    robot: form.elements.robot.value,
    name: form.elements.name.value.trim() || null,
    friction: friction.valueAsNumber,
    terrain: read.terrain,
    start_m: placeOf("start"),
    goal_m: placeOf("goal"),
  };
  try {
    return await call("POST", "/terrains/crossing", body);
  } catch (error) {
    const problem = /** @type {any} */ (error).problem;
    throw new Error((problem && crossingAdvice(problem)) ?? /** @type {Error} */ (error).message);
  }
}
