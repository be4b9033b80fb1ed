// The timeline under the 3D scene: play, step, scrub, speed, loop, and the time in the page's address.
import { unpack } from "./packed.js";
import { Scene } from "./scene.js";

const ADDRESS_EVERY_MS = 250, HEARTBEAT_MS = 400;
const stage = document.querySelector("[data-stage]");
const player = document.querySelector("[data-player]");
const frame = stage.querySelector("iframe");
const veil = stage.querySelector("[data-veil]");
const slider = player.querySelector("#time");
const clock = player.querySelector("[data-time]");
const speed = player.querySelector("[data-speed]");
const loop = player.querySelector("[data-loop]");
const magnified = player.querySelector("[data-magnified]");
const playButton = player.querySelector('[data-do="play"]');
const through = player.querySelector("[data-through]");
const base = stage.dataset.scene;

let scene = null, time_s = [], phases_s = [], at = 0, playing = false, last_ms = 0, addressed_ms = 0, addressLater = 0;

start().catch((error) => {
  veil.hidden = false;
  veil.textContent = error.message;
});

async function start() {
  const [layout, values] = await Promise.all([
    get(`${base}/frames.json`).then((answer) => answer.json()),
    get(`${base}/frames.bin`).then((answer) => answer.arrayBuffer()),
    get(`${base}/open`, { method: "POST" }),
  ]);
  time_s = layout.time_s;
  phases_s = layout.phase_starts_s;
  scene = new Scene(frame, layout, unpack(values, layout));
  // A layer of which nothing is there is not offered.
  for (const box of player.querySelectorAll("[data-show]")) {
    const there = [...scene.nodes.names, ...layout.still].some((name) => name.startsWith(box.dataset.show));
    box.closest("label").hidden = !there;
  }
  through.closest("label").hidden = scene.inside.length === 0;
  through.checked = new URLSearchParams(location.search).get("through") !== "0";
  magnified.closest("label").hidden = !layout.ellipsoids.length;
  frame.src = `${base}/?hideViserLogo&fixedDpr=1`;
  frame.hidden = false;
  await scene.nodes.ready();
  veil.hidden = true;
  slider.max = String(time_s.length - 1);
  slider.disabled = false;
  frame.contentWindow.addEventListener("keydown", (event) => onKey(event, false));
  applyShown();
  seek(frameAt(Number(new URLSearchParams(location.search).get("t") ?? player.dataset.start)), false);
  player.dataset.ready = "true";
  if (new URLSearchParams(location.search).has("play")) play(true);
  setInterval(() => playing || (scene.nodes.isStale() && scene.show(at)), HEARTBEAT_MS);
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
  let low = 0, high = time_s.length - 1;
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
  const phase = phaseAt(time_s[whole]);
  slider.setAttribute("aria-valuetext", `${time_s[whole].toFixed(3)} seconds, frame ${whole + 1}${phase < 0 ? "" : `, phase ${phase}`}`);
  clock.textContent = `${time_s[whole].toFixed(3)} s · frame ${whole + 1} of ${time_s.length}${phase < 0 ? "" : ` · phase ${phase}`}`;
  if (remember) rememberTime(whole);
}

// Phases count from 0; a boundary belongs to the phase that begins there. A recording has none.
function phaseAt(t_s) {
  return phases_s.findLastIndex((start_s) => start_s <= t_s + 1e-6);
}

function toPhase(step) {
  const now = phaseAt(time_s[Math.round(at)]);
  const target = phases_s[now + step];
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
  if (on && at >= time_s.length - 1) seek(0);
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
  let next = at + (Math.max(0, now_ms - last_ms) / 1000) * Number(speed.value) * rate_hz;
  last_ms = now_ms;
  if (next > time_s.length - 1) {
    if (!loop.checked) {
      seek(time_s.length - 1);
      play(false);
      return;
    }
    next %= time_s.length - 1;
  }
  seek(next);
  requestAnimationFrame(tick);
}

const deeds = {
  start: () => seek(0),
  back: () => step(-1),
  forward: () => step(1),
  play: () => play(!playing),
};
function step(frames) {
  if (playing) play(false);
  seek(Math.round(at) + frames);
}
for (const [name, deed] of Object.entries(deeds)) player.querySelector(`[data-do=${name}]`).addEventListener("click", () => scene && deed());
slider.addEventListener("input", () => {
  if (playing) play(false);
  seek(Number(slider.value));
});

for (const strip of player.querySelectorAll("[data-seek]")) {
  strip.addEventListener("click", (event) => {
    if (!time_s.length) return;
    const mark = event.target.dataset.at; // a check's worst moment, to the sample
    if (mark !== undefined) return void to(Number(mark));
    const box = strip.getBoundingClientRect();
    seek(frameAt(((event.clientX - box.left) / box.width) * time_s.at(-1)));
  });
}

player.querySelector("[data-moments]")?.addEventListener("change", (event) => {
  if (event.target.value && time_s.length) to(Number(event.target.value));
});
function to(t_s) {
  if (playing) play(false);
  seek(frameAt(t_s));
}

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

// In our page arrows step too; inside the scene they belong to viser's camera.
const KEYS = { " ": deeds.play, ",": () => step(-1), ".": () => step(1) };
const PAGE_KEYS = { ArrowLeft: () => step(-1), ArrowRight: () => step(1), Home: deeds.start, End: () => seek(time_s.length - 1) };
const PHASE_KEYS = { PageUp: () => toPhase(-1), PageDown: () => toPhase(1) };
function onKey(event, ours) {
  if (!scene?.nodes.viser || event.ctrlKey || event.metaKey || event.altKey) return;
  const name = event.target?.tagName;
  if (name === "SELECT" || (name === "INPUT" && event.target.type !== "range" && event.key !== "," && event.key !== ".")) return;
  if ((name === "BUTTON" || name === "A") && event.key === " ") return;
  if (name === "INPUT" && event.key in PAGE_KEYS) return; // the slider steps by itself
  const deed = KEYS[event.key] ?? (ours ? PAGE_KEYS[event.key] : undefined) ?? (phases_s.length ? PHASE_KEYS[event.key] : undefined);
  if (!deed) return;
  event.preventDefault();
  deed();
}
document.addEventListener("keydown", (event) => onKey(event, true));
