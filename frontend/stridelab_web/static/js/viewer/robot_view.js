// A robot in 3D with the reachable positions of its centre of mass: one effector and measure at a time, with layers.
import { ViserNodes } from "./viser_nodes.js";
import { CardContacts } from "./card_contacts.js";
import { AdaptiveResolution } from "./adaptive_resolution.js";
import { DarkMode } from "./dark_mode.js";
import { CAMERA_KEYS, Shortcuts } from "../shared/shortcuts.js";
import { fetchChecked } from "../shared/api.js";
import { showFailure, hideOverlay } from "./loading_overlay.js";

const STALE_CHECK_MS = 400,
  LEVELS = ["50", "80", "95"],
  PARTS = ["cloud", "mode", ...LEVELS],
  LITRES = 1000;
const root = document.querySelector("[data-robot-view]");
const part = (/** @type {string} */ name) => root.querySelector(`[data-${name}]`);
const iframe = part("stage").querySelector("iframe");
const scene = part("stage").dataset.scene,
  robot = root.dataset.robot;
const reach = JSON.parse(root.dataset.reach);
const measure = root.querySelector("[name=measure]"),
  effector = root.querySelector("[name=effector]");
const boxes = [...root.querySelectorAll("[data-part]")];
const reachNodes = Object.entries(reach).flatMap(([measureName, frames]) =>
  Object.keys(frames).map((name) => `/reach/${measureName}/${name}`),
);
const nodes = new ViserNodes(iframe, [
  "/robot",
  ...reachNodes,
  ...reachNodes.flatMap((name) => PARTS.map((partName) => `${name}/${partName}`)),
]);
let requestCount = 0;

start().catch((error) => showFailure(part("stage"), error));

async function start() {
  readAddress();
  await fetchChecked(`${scene}/open`, { method: "POST" });
  await nodes.ready();
  const darkMode = new DarkMode(nodes);
  new AdaptiveResolution(nodes);
  shortcuts.listenInFrame(iframe);
  render();
  await hideOverlay(part("stage"), nodes);
  const card = root.querySelector("[data-card-contacts]");
  if (card) await new CardContacts(card, part("stage"), nodes).start();
  root.dataset.ready = "true";
  setInterval(() => {
    if (!nodes.isStale()) return;
    darkMode.apply();
    render();
  }, STALE_CHECK_MS);
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

const isOn = (/** @type {string} */ name) => boxes.some((box) => box.dataset.part === name && box.checked);

function render() {
  const chosen = effector ? `/reach/${measure.value}/${effector.value}` : "";
  nodes.setVisible("/robot", isOn("robot"));
  for (const name of reachNodes) {
    nodes.setVisible(name, name === chosen);
    for (const partName of PARTS) nodes.setVisible(`${name}/${partName}`, name === chosen && isOn(partName));
    for (const [k, level] of LEVELS.entries()) nodes.drawTransparent(`${name}/${level}`, k + 1);
  }
  nodes.draw();
  writeAddress();
  if (effector) showVolumes();
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

// Shows the volumes of the chosen density.
async function showVolumes() {
  const request = ++requestCount;
  part("frame").textContent =
    reach[measure.value][effector.value] === "heading"
      ? "Heading frame: at the contact, z up, x where the trunk faces."
      : "Contact frame of the effector.";
  const query = new URLSearchParams({ measure: measure.value, effector: effector.value });
  const response = await fetch(`/robots/${robot}/reach.json?${query}`).catch(() => null);
  const volumes = response?.ok ? await response.json() : null;
  if (request !== requestCount) return;
  for (const cell of root.querySelectorAll("[data-volume]")) {
    const volume = volumes?.volumes_m3[String(Number(cell.dataset.volume) / 100)];
    cell.textContent = volume === undefined ? "–" : `${(volume * LITRES).toFixed(0)} l`;
  }
}

measure?.addEventListener("change", () => {
  fillEffectors();
  if (nodes.viser) render();
});
effector?.addEventListener("change", () => nodes.viser && render());
for (const box of boxes) box.addEventListener("change", () => nodes.viser && render());

/** @param {PageElement} select */
function selectNext(select) {
  if (!select) return;
  select.selectedIndex = (select.selectedIndex + 1) % select.options.length;
  select.dispatchEvent(new Event("change"));
}

const shortcuts = new Shortcuts(
  [
    { keys: ["e"], text: "Next effector", run: () => selectNext(effector), when: () => Boolean(effector) },
    { keys: ["m"], text: "Next measure", run: () => selectNext(measure), when: () => Boolean(measure) },
    ...boxes.map((box) => ({
      keys: [box.dataset.key],
      text: `Show or hide: ${box.dataset.text}`,
      run: () => box.click(),
    })),
    ...CAMERA_KEYS,
  ],
  () => Boolean(nodes.viser),
);
