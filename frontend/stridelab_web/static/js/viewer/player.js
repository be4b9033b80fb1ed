// The timeline under the 3D scene: play, step, scrub, speed, loop, and the time in the page's address.
import { Camera } from "./camera.js";
import { LoopRange } from "./loop_range.js";
import { unpack } from "./frame_decoder.js";
import { PictureDialog } from "./picture_dialog.js";
import { Pixels } from "./adaptive_resolution.js";
import { Room } from "./dark_mode.js";
import { Scene } from "./scene.js";
import { CAMERA_KEYS, Shortcuts } from "../shared/shortcuts.js";
import { failed, lift } from "./loading_overlay.js";

const ADDRESS_EVERY_MS = 250,
  HEARTBEAT_MS = 400;
const stage = document.querySelector("[data-stage]");
const player = document.querySelector("[data-player]");
const frame = stage.querySelector("iframe");
const slider = player.querySelector("#time");
const clock = player.querySelector("[data-time]");
const speed = player.querySelector("[data-speed]");
const loop = player.querySelector("[data-loop]");
const magnified = player.querySelector("[data-magnified]");
const playButton = player.querySelector('[data-do="play"]');
const through = player.querySelector("[data-through]");
const view = player.querySelector("[data-view]");
const followed = player.querySelector("[data-follow]");
const base = stage.dataset.scene;
const steps_s = JSON.parse(player.dataset.steps);
const range = new LoopRange(player.querySelector("[data-range]"), rememberRange);

/** @type {Scene} */
let scene;
/** @type {Camera} */
let camera;
/** @type {Room} */
let room;
let time_s = [],
  phases_s = [],
  starts_s = [],
  at = 0,
  playing = false,
  last_ms = 0,
  addressed_ms = 0,
  addressLater = 0;

start().catch((error) => failed(stage, error));

async function start() {
  const [[layout, values]] = await Promise.all([
    get(`${base}/frames.bin`)
      .then((answer) => answer.arrayBuffer())
      .then(unpack),
    get(`${base}/open`, { method: "POST" }),
  ]);
  time_s = layout.time_s;
  phases_s = layout.phase_starts_s;
  starts_s = phases_s.length ? phases_s : steps_s.map(([start_s]) => start_s);
  scene = new Scene(frame, layout, values);
  camera = new Camera(scene);
  // A layer of which nothing is there is not offered.
  for (const box of player.querySelectorAll("[data-show]")) {
    const there = [...scene.nodes.names, ...layout.still].some((name) => name.startsWith(box.dataset.show));
    box.closest("label").hidden = !there;
  }
  through.closest("label").hidden = scene.inside.length === 0;
  through.checked = new URLSearchParams(location.search).get("through") !== "0";
  magnified.closest("label").hidden = !layout.ellipsoids.length;
  await scene.nodes.ready();
  room = new Room(scene.nodes, scene.tinted);
  new Pixels(scene.nodes, () => playing);
  slider.max = String(time_s.length - 1);
  slider.disabled = false;
  shortcuts.enter(frame);
  applyShown();
  const query = new URLSearchParams(location.search);
  range.begin(time_s, ...["from", "to"].map((name) => (query.has(name) ? Number(query.get(name)) : NaN)));
  seek(frameAt(Number(query.get("t") ?? player.dataset.start)), false);
  if (camera.near(at)) {
    followed.checked = true;
    camera.follow(true, at);
  }
  await lift(stage, scene.nodes);
  player.dataset.ready = "true";
  if (query.has("play")) play(true);
  setInterval(() => {
    if (!scene.nodes.isStale()) return;
    room.show();
    if (!playing) scene.show(at);
  }, HEARTBEAT_MS);
}

async function get(url, options) {
  const answer = await fetch(url, options);
  if (answer.ok) return answer;
  const said = await answer.json().catch(() => ({}));
  throw new Error(said.detail || "The scene could not be read.");
}

// The nearest frame to a time; the two are not assumed to be proportional.
function frameAt(t_s) {
  if (!(t_s > 0)) return 0;
  let low = 0,
    high = time_s.length - 1;
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (time_s[middle] <= t_s) low = middle;
    else high = middle;
  }
  return t_s - time_s[low] <= time_s[high] - t_s ? low : high;
}

function seek(target, remember = true) {
  at = Math.min(Math.max(target, 0), time_s.length - 1);
  const whole = Math.round(at);
  scene.show(at);
  slider.value = String(whole);
  camera.shown(at);
  const part = partAt(time_s[whole]);
  slider.setAttribute(
    "aria-valuetext",
    `${time_s[whole].toFixed(3)} seconds, frame ${whole + 1}${part && `, ${part}`}`,
  );
  clock.textContent = `${time_s[whole].toFixed(3)} s · frame ${whole + 1} of ${time_s.length}${part && ` · ${part}`}`;
  if (remember) rememberTime(whole);
}

// Phases count from 0; a boundary belongs to the phase that begins there. A recording has none.
function phaseAt(t_s) {
  return phases_s.findLastIndex((start_s) => start_s <= t_s + 1e-6);
}

// The phase of a plan; of a walk the step, and how much of it is over, where its steps are known.
function partAt(t_s) {
  if (phases_s.length) return `phase ${phaseAt(t_s)}`;
  const k = steps_s.findIndex(([start_s, end_s]) => start_s <= t_s + 1e-6 && t_s < end_s);
  if (k < 0) return "";
  const [start_s, end_s] = steps_s[k];
  return `step ${k + 1} of ${steps_s.length}, ${Math.round((100 * (t_s - start_s)) / (end_s - start_s))} %`;
}

function toPhase(step) {
  const now = starts_s.findLastIndex((start_s) => start_s <= time_s[Math.round(at)] + 1e-6);
  const target = starts_s[now + step];
  if (playing) play(false);
  if (target !== undefined) seek(frameAt(target));
  else seek(step < 0 ? 0 : time_s.length - 1);
}

function rememberTime(whole) {
  const write = () => {
    addressed_ms = performance.now();
    const url = new URL(location.href);
    url.searchParams.delete("play");
    url.searchParams.set("t", time_s[whole].toFixed(3));
    history.replaceState(null, "", url);
  };
  clearTimeout(addressLater);
  const wait = ADDRESS_EVERY_MS - (performance.now() - addressed_ms);
  if (wait <= 0) write();
  else addressLater = setTimeout(write, wait);
}

function play(on) {
  playing = on;
  if (on && (at >= range.to || at < range.from)) seek(range.from);
  playButton.setAttribute("aria-pressed", String(on));
  playButton.setAttribute("aria-label", on ? "Pause (space)" : "Play (space)");
  playButton.querySelector("[data-icon=play]").toggleAttribute("hidden", on);
  playButton.querySelector("[data-icon=pause]").toggleAttribute("hidden", !on);
  if (!on) seek(Math.round(at));
  last_ms = performance.now();
  if (on) requestAnimationFrame(tick);
}

function tick(now_ms) {
  if (!playing) return;
  const rate_hz = (time_s.length - 1) / (time_s.at(-1) - time_s[0]);
  const next = at + (Math.max(0, now_ms - last_ms) / 1000) * Number(speed.value) * rate_hz;
  last_ms = now_ms;
  if (next > range.to && !loop.checked) {
    seek(range.to);
    play(false);
    return;
  }
  seek(range.wrapped(next));
  requestAnimationFrame(tick);
}

const deeds = {
  start: () => seek(0),
  back: () => step(-1),
  forward: () => step(1),
  play: () => play(!playing),
  from: () => range.set("from", Math.round(at)),
  to: () => range.set("to", Math.round(at)),
  whole: () => range.clear(),
};
function step(frames) {
  if (playing) play(false);
  seek(Math.round(at) + frames);
}
for (const [name, deed] of Object.entries(deeds))
  player.querySelector(`[data-do=${name}]`).addEventListener("click", () => scene && deed());
slider.addEventListener("input", () => {
  if (playing) play(false);
  seek(Number(slider.value));
});

for (const strip of player.querySelectorAll("[data-seek]")) {
  strip.addEventListener("click", (event) => {
    if (!time_s.length) return;
    const mark = /** @type {PageElement} */ (event.target).dataset.at; // a check's worst moment, to the sample
    if (mark !== undefined) return void to(Number(mark));
    const box = strip.getBoundingClientRect();
    seek(frameAt(((event.clientX - box.left) / box.width) * time_s.at(-1)));
  });
}

const moments = player.querySelector("[data-moments]");
moments?.addEventListener("change", () => {
  if (moments.value && time_s.length) to(Number(moments.value));
});
function to(t_s) {
  if (playing) play(false);
  seek(frameAt(t_s));
}

// The range stays in the address, so that a reload and a link keep it.
function rememberRange() {
  const url = new URL(location.href);
  for (const end of ["from", "to"]) {
    if (range.whole) url.searchParams.delete(end);
    else url.searchParams.set(end, time_s[range[end]].toFixed(3));
  }
  history.replaceState(null, "", url);
}

view.addEventListener("change", () => look(view.value));
function look(from) {
  view.value = from;
  if (scene?.nodes.viser) camera.look(from);
}
followed.addEventListener("change", () => scene?.nodes.viser && camera.follow(followed.checked, at));
const pictures = new PictureDialog(document.querySelector("[data-picture]"), {
  viser: () => scene?.nodes.viser,
  name: () => `${player.dataset.name} ${time_s[Math.round(at)].toFixed(3)} s`,
});
player.querySelector("[data-do=picture]").addEventListener("click", () => scene?.nodes.viser && pictures.open());

function applyShown() {
  scene.through = through.checked;
  scene.magnified = Number(magnified.value);
  scene.hide([...player.querySelectorAll("[data-show]")].filter((box) => !box.checked).map((box) => box.dataset.show));
}
for (const box of player.querySelectorAll("[data-show], [data-magnified]")) {
  box.addEventListener("change", () => {
    if (!scene?.nodes.viser) return;
    applyShown();
    scene.show(at);
  });
}

through.addEventListener("change", () => {
  const url = new URL(location.href);
  if (through.checked) url.searchParams.delete("through");
  else url.searchParams.set("through", "0");
  history.replaceState(null, "", url);
  if (!scene?.nodes.viser) return;
  applyShown();
  scene.show(at);
});

const follow = () => followed.click();
// Inside the scene the arrow keys turn viser's camera.
const shortcuts = new Shortcuts(
  [
    { keys: [" "], text: "Play, pause", run: deeds.play },
    { keys: [","], text: "One frame back", run: deeds.back },
    { keys: ["."], text: "One frame forward", run: deeds.forward },
    { keys: ["ArrowLeft"], text: "One frame back, outside the scene", run: deeds.back, page: true },
    { keys: ["ArrowRight"], text: "One frame forward, outside the scene", run: deeds.forward, page: true },
    { keys: ["Home"], text: "First frame", run: deeds.start },
    { keys: ["End"], text: "Last frame", run: () => seek(time_s.length - 1) },
    { keys: ["PageUp"], text: "Phase or step before", run: () => toPhase(-1), when: () => starts_s.length > 0 },
    { keys: ["PageDown"], text: "Phase or step after", run: () => toPhase(1), when: () => starts_s.length > 0 },
    { keys: ["["], text: "Play from here", run: deeds.from },
    { keys: ["]"], text: "Play to here", run: deeds.to },
    { keys: ["\\"], text: "Play all", run: deeds.whole },
    { keys: ["1"], text: "View from the side", run: () => look("side") },
    { keys: ["2"], text: "View from the front", run: () => look("front") },
    { keys: ["3"], text: "View from above", run: () => look("above") },
    { keys: ["4"], text: "The view follows what moves", run: follow },
    { keys: ["p"], text: "Picture of the scene", run: () => pictures.open() },
    ...CAMERA_KEYS,
  ],
  () => Boolean(scene?.nodes.viser),
);
