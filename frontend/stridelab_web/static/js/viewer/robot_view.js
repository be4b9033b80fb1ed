// A robot in 3D with where its centre of mass can be: one effector and measure at a time, each part with a key.
import { Nodes } from "./viser_nodes.js";
import { Pixels } from "./adaptive_resolution.js";
import { Room } from "./dark_mode.js";
import { CAMERA_KEYS, Shortcuts } from "../shared/shortcuts.js";
import { failed, lift } from "./loading_overlay.js";

const HEARTBEAT_MS = 400,
  LEVELS = ["50", "80", "95"],
  PARTS = ["cloud", "mode", ...LEVELS],
  LITRES = 1000;
const root = document.querySelector("[data-robot-view]");
const part = (name) => root.querySelector(`[data-${name}]`);
const frame = part("stage").querySelector("iframe");
const scene = part("stage").dataset.scene,
  robot = root.dataset.robot;
const reach = JSON.parse(root.dataset.reach);
const measure = root.querySelector("[name=measure]"),
  effector = root.querySelector("[name=effector]");
const boxes = [...root.querySelectorAll("[data-part]")];
const all = Object.entries(reach).flatMap(([under, frames]) =>
  Object.keys(frames).map((name) => `/reach/${under}/${name}`),
);
const nodes = new Nodes(frame, ["/robot", ...all, ...all.flatMap((name) => PARTS.map((below) => `${name}/${below}`))]);
let asked = 0;

start().catch((error) => failed(part("stage"), error));

async function start() {
  readAddress();
  const answer = await fetch(`${scene}/open`, { method: "POST" }).catch(() => null);
  if (!answer?.ok) throw new Error((await answer?.json().catch(() => null))?.detail || "The scene could not be read.");
  await nodes.ready();
  const room = new Room(nodes);
  new Pixels(nodes);
  shortcuts.enter(frame);
  show();
  await lift(part("stage"), nodes);
  root.dataset.ready = "true";
  setInterval(() => {
    if (!nodes.isStale()) return;
    room.show();
    show();
  }, HEARTBEAT_MS);
}

function readAddress() {
  const query = new URLSearchParams(location.search);
  if (effector) {
    fillEffectors();
    const name = query.get("effector") ?? "";
    if (name in (reach[measure.value] ?? {})) effector.value = name;
  }
  const wanted = query.get("show")?.split(",");
  if (wanted) for (const box of boxes) box.checked = wanted.includes(box.dataset.part);
}

function fillEffectors() {
  const before = effector.value;
  effector.replaceChildren(
    ...Object.keys(reach[measure.value]).map((name) => new Option(name.replaceAll("_", " "), name)),
  );
  if (before in reach[measure.value]) effector.value = before;
}

const isOn = (name) => boxes.some((box) => box.dataset.part === name && box.checked);

function show() {
  const chosen = effector ? `/reach/${measure.value}/${effector.value}` : "";
  nodes.see("/robot", isOn("robot"));
  for (const name of all) {
    nodes.see(name, name === chosen);
    for (const below of PARTS) nodes.see(`${name}/${below}`, name === chosen && isOn(below));
    for (const [k, level] of LEVELS.entries()) nodes.veil(`${name}/${level}`, k + 1);
  }
  nodes.draw();
  writeAddress();
  if (effector) tell();
}

function writeAddress() {
  const url = new URL(location.href);
  if (effector) {
    url.searchParams.set("measure", measure.value);
    url.searchParams.set("effector", effector.value);
  }
  url.searchParams.set(
    "show",
    boxes
      .filter((box) => box.checked)
      .map((box) => box.dataset.part)
      .join(","),
  );
  history.replaceState(null, "", url);
}

// The numbers of what is shown.
async function tell() {
  const turn = ++asked;
  part("frame").textContent =
    reach[measure.value][effector.value] === "heading"
      ? "Heading frame: at the contact, z up, x where the trunk faces."
      : "Contact frame of the effector.";
  const query = new URLSearchParams({ measure: measure.value, effector: effector.value });
  const answer = await fetch(`/robots/${robot}/reach.json?${query}`).catch(() => null);
  const found = answer?.ok ? await answer.json() : null;
  if (turn !== asked) return;
  for (const cell of root.querySelectorAll("[data-volume]")) {
    const volume = found?.volumes_m3[String(Number(cell.dataset.volume) / 100)];
    cell.textContent = volume === undefined ? "–" : `${(volume * LITRES).toFixed(0)} l`;
  }
}

measure?.addEventListener("change", () => {
  fillEffectors();
  if (nodes.viser) show();
});
effector?.addEventListener("change", () => nodes.viser && show());
for (const box of boxes) box.addEventListener("change", () => nodes.viser && show());

function next(select) {
  if (!select) return;
  select.selectedIndex = (select.selectedIndex + 1) % select.options.length;
  select.dispatchEvent(new Event("change"));
}

const shortcuts = new Shortcuts(
  [
    { keys: ["e"], text: "Next effector", run: () => next(effector), when: () => Boolean(effector) },
    { keys: ["m"], text: "Next measure", run: () => next(measure), when: () => Boolean(measure) },
    ...boxes.map((box) => ({
      keys: [box.dataset.key],
      text: `Show or hide: ${box.dataset.text}`,
      run: () => box.click(),
    })),
    ...CAMERA_KEYS,
  ],
  () => Boolean(nodes.viser),
);
