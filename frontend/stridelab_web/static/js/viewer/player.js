// The player of the 3D scene: play, step, scrub, speed, loop, layers and views; time and range are kept in the address.
import { Camera } from "./camera.js";
import { HoverNames } from "./hover_names.js";
import { LoopRange } from "./loop_range.js";
import { decodeFrames } from "./frame_decoder.js";
import { PictureDialog } from "./picture_dialog.js";
import { SceneAddress } from "./scene_address.js";
import { AdaptiveResolution } from "./adaptive_resolution.js";
import { DarkMode } from "./dark_mode.js";
import { Scene } from "./scene.js";
import { CAMERA_KEYS, Shortcuts } from "../shared/shortcuts.js";
import { fetchChecked } from "../shared/api.js";
import { showLayerColours } from "../shared/layer_colours.js";
import { framePosition, nearestFrame } from "./interpolation.js";
import { showFailure, hideOverlay, showGoneFiles } from "./loading_overlay.js";
import { translate } from "../shared/translate.js";

const URL_INTERVAL_MS = 250,
  STALE_CHECK_MS = 400;
const stage = document.querySelector("[data-stage]");
const player = document.querySelector("[data-player]");
const iframe = stage.querySelector("iframe");
const slider = player.querySelector("#time");
const clock = player.querySelector("[data-time]");
const speed = player.querySelector("[data-speed]");
const loop = player.querySelector("[data-loop]");
const magnification = player.querySelector("[data-magnified]");
const playButton = player.querySelector('[data-do="play"]');
const seeThrough = player.querySelector("[data-through]");
const view = player.querySelector("[data-view]");
const followBox = player.querySelector("[data-follow]");
const base = stage.dataset.scene;
const steps_s = JSON.parse(player.dataset.steps);
const address = new SceneAddress(player);
const range = new LoopRange(player.querySelector("[data-range]"), writeRangeToUrl);

/** @type {Scene} */
let scene;
/** @type {Camera} */
let camera;
let hoverNames = /** @type {HoverNames | undefined} */ (undefined);
/** @type {DarkMode} */
let darkMode;
let /** @type {number[]} */ time_s = [],
  /** @type {number[]} */ phases_s = [],
  /** @type {number[]} */ starts_s = [],
  position = 0,
  playing = false,
  filming = false,
  last_ms = 0,
  urlWritten_ms = 0,
  urlTimer = 0;

start().catch((error) => showFailure(stage, error));

async function start() {
  const [[layout, values]] = await Promise.all([
    fetchChecked(`${base}/frames.bin`)
      .then((response) => response.arrayBuffer())
      .then(decodeFrames),
    fetchChecked(`${base}/open`, { method: "POST" }),
  ]);
  time_s = layout.time_s;
  phases_s = layout.phase_starts_s;
  starts_s = phases_s.length ? phases_s : steps_s.map((/** @type {[number]} */ [start_s]) => start_s);
  scene = new Scene(iframe, layout, values);
  camera = new Camera(scene);
  // Hides the checkboxes of layers without nodes.
  for (const box of player.querySelectorAll("[data-show]")) {
    const exists = [...scene.nodes.names, ...layout.still].some((name) => name.startsWith(box.dataset.show));
    box.closest("label").hidden = !exists;
  }
  seeThrough.closest("label").hidden = scene.interiorNodes.length === 0;
  seeThrough.checked = new URLSearchParams(location.search).get("through") !== "0";
  magnification.closest("label").hidden = !layout.ellipsoids.length;
  await scene.nodes.ready();
  darkMode = new DarkMode(scene.nodes, scene.tintedNodes);
  showLayerColours(player, scene.nodes);
  hoverNames = new HoverNames(stage, iframe, scene, camera);
  new AdaptiveResolution(scene.nodes, () => playing);
  slider.max = String(time_s.length - 1);
  slider.disabled = false;
  shortcuts.listenInFrame(iframe);
  applyLayers();
  const query = new URLSearchParams(location.search);
  const [from_s, to_s] = ["from", "to"].map((name) => (query.has(name) ? Number(query.get(name)) : NaN));
  range.setFrames(time_s, from_s, to_s);
  seek(nearestFrame(time_s, Number(query.get("t") ?? player.dataset.start)), false);
  const isRestored = address.restoreCamera(camera);
  if (isRestored ? address.isFollowing : camera.moveNear(position)) {
    followBox.checked = true;
    camera.follow(true, position);
  }
  await hideOverlay(stage, scene.nodes);
  showGoneFiles(player, layout.gone);
  player.dataset.ready = "true";
  if (query.has("play")) play(true);
  setInterval(() => {
    if (!filming) address.update();
    if (!scene.nodes.isStale()) return;
    darkMode.apply();
    if (!playing) scene.show(position);
  }, STALE_CHECK_MS);
}

// Draws the present frame of a film once more; in full where viser has made its nodes anew.
function redrawFilmed() {
  if (scene.nodes.isStale()) scene.show(position);
  else scene.nodes.redraw();
}

/** @param {number} target */
function seek(target, inUrl = true) {
  position = Math.min(Math.max(target, 0), time_s.length - 1);
  const index = Math.round(position);
  scene.show(position);
  slider.value = String(index);
  camera.onFrame(position);
  hoverNames?.update();
  const label = phaseLabel(time_s[index]);
  const values = { time: time_s[index].toFixed(3), frame: index + 1, number: time_s.length };
  const spoken = translate("%(time)s seconds, frame %(frame)s", values);
  const shown = translate("%(time)s s · frame %(frame)s of %(number)s", values);
  slider.setAttribute("aria-valuetext", label ? `${spoken}, ${label}` : spoken);
  document.dispatchEvent(new CustomEvent("instant", { detail: time_s[index] }));
  clock.textContent = label ? `${shown} · ${label}` : shown;
  if (inUrl) writeTimeToUrl(index);
}

// The phase at a time, counted from 0; a boundary belongs to the phase that starts there. Recordings have no phases.
/** @param {number} t_s */
function phaseAt(t_s) {
  return phases_s.findLastIndex((start_s) => start_s <= t_s + 1e-6);
}

// The phase of a plan, or the step of a walk and its elapsed part, if its steps are detected.
/** @param {number} t_s */
function phaseLabel(t_s) {
  if (phases_s.length) return translate("phase %(phase)s", { phase: phaseAt(t_s) });
  const k = steps_s.findIndex(
    (/** @type {[number, number]} */ [start_s, end_s]) => start_s <= t_s + 1e-6 && t_s < end_s,
  );
  if (k < 0) return "";
  const [start_s, end_s] = steps_s[k];
  const percent = Math.round((100 * (t_s - start_s)) / (end_s - start_s));
  return translate("step %(step)s of %(number)s, %(percent)s %", { step: k + 1, number: steps_s.length, percent });
}

/** @param {number} step */
function seekPhase(step) {
  const now = starts_s.findLastIndex((start_s) => start_s <= time_s[Math.round(position)] + 1e-6);
  const target = starts_s[now + step];
  if (playing) play(false);
  if (target !== undefined) seek(nearestFrame(time_s, target));
  else seek(step < 0 ? 0 : time_s.length - 1);
}

/** @param {number} index */
function writeTimeToUrl(index, atOnce = false) {
  const write = () => {
    urlWritten_ms = performance.now();
    const url = new URL(location.href);
    url.searchParams.delete("play");
    url.searchParams.set("t", time_s[index].toFixed(3));
    history.replaceState(null, "", url);
  };
  clearTimeout(urlTimer);
  const wait = URL_INTERVAL_MS - (performance.now() - urlWritten_ms);
  if (wait <= 0 || atOnce) write();
  else urlTimer = setTimeout(write, wait);
}

/** @param {boolean} on */
function play(on) {
  playing = on;
  if (on && (position >= range.to || position < range.from)) seek(range.from);
  playButton.setAttribute("aria-pressed", String(on));
  playButton.setAttribute("aria-label", on ? translate("Pause (space)") : translate("Play (space)"));
  playButton.querySelector("[data-icon=play]").toggleAttribute("hidden", on);
  playButton.querySelector("[data-icon=pause]").toggleAttribute("hidden", !on);
  if (!on) seek(Math.round(position));
  last_ms = performance.now();
  if (on) requestAnimationFrame(tick);
}

/** @param {number} now_ms */
function tick(now_ms) {
  if (!playing) return;
  const rate_hz = (time_s.length - 1) / (range.end_s - time_s[0]);
  const next = position + (Math.max(0, now_ms - last_ms) / 1000) * Number(speed.value) * rate_hz;
  last_ms = now_ms;
  if (next > range.to && !loop.checked) {
    seek(range.to);
    play(false);
    return;
  }
  seek(range.wrapFrame(next));
  requestAnimationFrame(tick);
}

const actions = {
  start: () => seek(0),
  back: () => step(-1),
  forward: () => step(1),
  play: () => play(!playing),
  from: () => range.setEnd("from", Math.round(position)),
  to: () => range.setEnd("to", Math.round(position)),
  whole: () => range.reset(),
  cycle: playCycle,
};
// Plays the gait cycle at the present time, two steps, again and again at a quarter of the speed.
function playCycle() {
  const t_s = time_s[Math.round(position)] + 1e-6,
    now = steps_s.findLastIndex((/** @type {[number]} */ [start_s]) => start_s <= t_s);
  const first = Math.max(Math.min(now, steps_s.length - 2), 0);
  range.setFrames(time_s, steps_s[first][0], steps_s[Math.min(first + 1, steps_s.length - 1)][1]);
  range.onChange();
  speed.value = "0.25";
  loop.checked = true;
  seek(range.from);
  play(true);
}
/** @param {number} frames */
function step(frames) {
  if (playing) play(false);
  seek(Math.round(position) + frames);
}
for (const [name, action] of Object.entries(actions))
  player.querySelector(`[data-do=${name}]`).addEventListener("click", () => scene && action());
slider.addEventListener("input", () => {
  const target = Number(slider.value); // pausing writes the present frame into it
  if (playing) play(false);
  seek(target);
});

for (const strip of player.querySelectorAll("[data-seek]")) {
  strip.addEventListener("click", (event) => {
    if (!time_s.length) return;
    const mark = /** @type {PageElement} */ (event.target).dataset.at; // the time of a check's worst sample
    if (mark !== undefined) return void pauseAndSeek(Number(mark));
    const box = strip.getBoundingClientRect();
    seek(nearestFrame(time_s, ((event.clientX - box.left) / box.width) * time_s[time_s.length - 1]));
  });
}

// A page that contains this one moves its cursor.
document.addEventListener("seek", ({ detail }) => {
  if (player.dataset.ready) pauseAndSeek(detail);
});

const moments = player.querySelector("[data-moments]");
moments?.addEventListener("change", () => {
  if (moments.value && time_s.length) pauseAndSeek(Number(moments.value));
});
/** @param {number} t_s */
function pauseAndSeek(t_s) {
  if (playing) play(false);
  seek(nearestFrame(time_s, t_s));
}

// Writes the looped range into the address, so that a reload or a link restores it.
function writeRangeToUrl() {
  const url = new URL(location.href);
  for (const end of /** @type {("from" | "to")[]} */ (["from", "to"])) {
    if (range.isWhole) url.searchParams.delete(end);
    else url.searchParams.set(end, time_s[range[end]].toFixed(3));
  }
  history.replaceState(null, "", url);
}

view.addEventListener("change", () => lookFrom(view.value));
/** @param {string} from */
function lookFrom(from) {
  view.value = from;
  if (scene?.nodes.viser) camera.lookFrom(from);
}
followBox.addEventListener("change", () => {
  address.writeFollow();
  if (scene?.nodes.viser) camera.follow(followBox.checked, position);
});
const pictures = new PictureDialog(document.querySelector("[data-picture]"), {
  viser: () => scene?.nodes.viser,
  name: () => `${player.dataset.name} ${time_s[Math.round(position)].toFixed(3)} s`,
});
const filmSource = {
  viser: () => scene?.nodes.viser,
  name: () => player.dataset.name,
  range_s: () => [time_s[range.from], time_s[range.to]],
  speed: () => Number(speed.value),
  seek: (/** @type {number} */ t_s) => {
    filming = true;
    position = framePosition(time_s, t_s);
    scene.show(position);
    camera.onFrame(position);
  },
  redraw: redrawFilmed,
  settled: () => scene.nodes.isPlaced() && !scene.nodes.isStale(),
  restore: () => {
    filming = false;
    seek(Math.round(position));
  },
};
/** @type {import("../film/film_dialog.js").FilmDialog | undefined} */
let films;
// The modules of films are loaded when the first one is wanted.
async function openFilm() {
  if (playing) play(false);
  const { FilmDialog } = await import("../film/film_dialog.js");
  films ??= new FilmDialog(document.querySelector("[data-film]"), filmSource);
  films.open();
}
player.querySelector("[data-do=film]").addEventListener("click", () => scene?.nodes.viser && openFilm());
const linkStatus = player.querySelector("[data-said-link]");
player.querySelector("[data-do=link]").addEventListener("click", copyLink);

// Copies the address of this view; where the browser does not allow it, says where it is.
async function copyLink() {
  if (scene?.nodes.viser) address.update();
  writeTimeToUrl(Math.round(position), true);
  try {
    await navigator.clipboard.writeText(location.href);
    linkStatus.textContent = translate("Copied.");
  } catch {
    linkStatus.textContent = translate("The address of this page is the link.");
  }
  setTimeout(() => {
    linkStatus.textContent = "";
  }, 4000);
}
player.querySelector("[data-do=picture]").addEventListener("click", () => scene?.nodes.viser && pictures.open());

function applyLayers() {
  scene.seeThrough = seeThrough.checked;
  scene.magnification = Number(magnification.value);
  scene.hideGroups(
    [...player.querySelectorAll("[data-show]")].filter((box) => !box.checked).map((box) => box.dataset.show),
  );
}
for (const box of player.querySelectorAll("[data-show], [data-magnified]")) {
  box.addEventListener("change", () => {
    if (!scene?.nodes.viser) return;
    applyLayers();
    scene.show(position);
  });
}

seeThrough.addEventListener("change", () => {
  const url = new URL(location.href);
  if (seeThrough.checked) url.searchParams.delete("through");
  else url.searchParams.set("through", "0");
  history.replaceState(null, "", url);
  if (!scene?.nodes.viser) return;
  applyLayers();
  scene.show(position);
});

const follow = () => followBox.click();
// In the scene, the arrow keys turn viser's camera.
const shortcuts = new Shortcuts(
  [
    { keys: [" "], text: translate("Play, pause"), run: actions.play },
    { keys: [","], text: translate("One frame back"), run: actions.back },
    { keys: ["."], text: translate("One frame forward"), run: actions.forward },
    { keys: ["ArrowLeft"], text: translate("One frame back, outside the scene"), run: actions.back, page: true },
    { keys: ["ArrowRight"], text: translate("One frame forward, outside the scene"), run: actions.forward, page: true },
    { keys: ["Home"], text: translate("First frame"), run: actions.start },
    { keys: ["End"], text: translate("Last frame"), run: () => seek(time_s.length - 1) },
    {
      keys: ["PageUp"],
      text: translate("Previous phase or step"),
      run: () => seekPhase(-1),
      when: () => starts_s.length > 0,
    },
    {
      keys: ["PageDown"],
      text: translate("Next phase or step"),
      run: () => seekPhase(1),
      when: () => starts_s.length > 0,
    },
    { keys: ["c"], text: translate("Gait cycle in slow motion"), run: actions.cycle, when: () => steps_s.length > 0 },
    { keys: ["["], text: translate("Play from here"), run: actions.from },
    { keys: ["]"], text: translate("Play to here"), run: actions.to },
    { keys: ["\\"], text: translate("Play all"), run: actions.whole },
    { keys: ["1"], text: translate("View from the side"), run: () => lookFrom("side") },
    { keys: ["2"], text: translate("View from the front"), run: () => lookFrom("front") },
    { keys: ["3"], text: translate("View from above"), run: () => lookFrom("above") },
    { keys: ["4"], text: translate("View follows the motion"), run: follow },
    { keys: ["p"], text: translate("Picture of the scene"), run: () => pictures.open() },
    { keys: ["f"], text: translate("Film of the played range"), run: openFilm },
    { keys: ["l"], text: translate("Copy a link to this view"), run: copyLink },
    ...CAMERA_KEYS,
  ],
  () => Boolean(scene?.nodes.viser),
);
