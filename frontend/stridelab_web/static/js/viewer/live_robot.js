// A live robot in 3D: moves its links as frames arrive, and sends pushes, settings and orders.
import { AdaptiveResolution } from "./adaptive_resolution.js";
import { Camera } from "./camera.js";
import { DarkMode } from "./dark_mode.js";
import { LiveOverlay, directedImpulse } from "./live_overlay.js";
import { Steering } from "./live_steering.js";
import { hideOverlay, showFailure } from "./loading_overlay.js";
import { HIDDEN, ViserNodes } from "./viser_nodes.js";
import { counted } from "../shared/plurals.js";
import { CAMERA_KEYS, Shortcuts } from "../shared/shortcuts.js";
import { fetchChecked } from "../shared/api.js";
import { checkConnection, isAnswering, isLoggedOut, onRestored } from "../shared/connection_notice.js";
import { createElement } from "../shared/elements.js";
import { Silence } from "../shared/silence.js";

const RECONNECT_MS = 2000,
  QUIET_MS = 2000, // fifty frames per second come while it moves, a state each second
  REST = [0, 0, 0],
  UPRIGHT = [1, 0, 0, 0],
  SLOW_PACE = 0.95,
  SETTLE_MS = 1000, // after which states contain what a slider has sent
  STILL = 0.005, // m/s and rad/s
  UNUSED_NODES = ["/reach/", "/support/", "/live/"]; // of the pages that plan and show densities
const root = document.querySelector("[data-live-robot]");
const part = (/** @type {string} */ name) => root.querySelector(`[data-${name}]`);
const field = (/** @type {string} */ name) => root.querySelector(`[name=${name}]`);
const fact = (/** @type {string} */ name, /** @type {string} */ text) => {
  root.querySelector(`[data-fact="${name}"]`).textContent = text;
};
const stage = part("stage"),
  iframe = stage.querySelector("iframe");
const nodes = new ViserNodes(iframe, ["/robot"]);
const orders = [...root.querySelectorAll("[data-order]")];
const sliders = [...root.querySelectorAll("[data-setting]")];
/** @type {Map<PageElement, number>} */
const sentUntil = new Map(); // until when states may be older than a slider's own value
/** @type {Record<string, (v: number) => string>} */
const UNITS = {
  friction: (v) => v.toFixed(2),
  payload_kg: (v) => `${v.toFixed(0)} kg`,
  delay_s: (v) => `${(1000 * v).toFixed(0)} ms`,
  expected_delay_s: (v) => `${(1000 * v).toFixed(0)} ms`,
  floor_time_s: (v) => `${(1000 * v).toFixed(0)} ms`,
  pace: (v) => `${(100 * v).toFixed(0)} %`,
};

/** @type {WebSocket | null} */
let socket = null;
/** @type {any} */
let robot = null;
/** @type {any} */
let state = null;
/** @type {any} */
let latest = null;
/** @type {any} */
let drawn = null;
let pushNumber = 0;
let isReady = false;
let wasDrawn = false;
let isInterrupted = false;
let isOver = false;
let reconnectTimer = 0;

const live = {
  nodes,
  layout: {
    n_frames: 1,
    width: 3,
    points: /** @type {MovingScene["layout"]["points"]} */ ([["/com/live", 0]]),
    bodies: [],
    sticks: [],
  },
  values: REST,
};
const camera = new Camera(live);
const overlay = new LiveOverlay(/** @type {any} */ (part("marks")), camera, {
  send: (impulse_ns, link) => push(impulse_ns, robot.links[link]),
  shown: () => ({
    forces: field("forces").checked,
    balance: field("balance").checked,
    horizon: field("horizon").checked,
  }),
  soles: () => robot?.soles_m ?? {},
  mass: () => robot?.mass_kg ?? 1,
});

const silence = new Silence(QUIET_MS, async () => {
  await checkConnection();
  if (!isAnswering()) setActing(false);
});
onRestored(() => {
  if (isOver) return;
  clearTimeout(reconnectTimer);
  if (socket) replaceSocket(socket);
  else connect();
});
connect();
openScene().catch((error) => showFailure(stage, error));

async function openScene() {
  await fetchChecked(`${stage.dataset.scene}/open`, { method: "POST" });
  await nodes.ready();
  new DarkMode(nodes);
  new AdaptiveResolution(nodes, () => state?.phase === "running");
  shortcuts.listenInFrame(iframe);
  isReady = true;
  requestAnimationFrame(drawAlways);
  await hideOverlay(stage, nodes);
  root.dataset.ready = "true";
}

function connect() {
  const scheme = location.protocol === "https:" ? "wss" : "ws";
  const opened = new WebSocket(`${scheme}://${location.host}/api/v1/live/${root.dataset.session}`);
  socket = opened;
  opened.addEventListener("message", (message) => socket === opened && receive(JSON.parse(message.data)));
  opened.addEventListener("close", (event) => {
    if (socket !== opened) return;
    socket = null;
    setActing(false);
    if (event.code === 1000 || event.code === 4404) {
      isOver = true;
      silence.stop();
      const link = createElement("a", { href: "/live/robots" }, "Start a new one");
      part("said").replaceChildren("This robot is no longer live. ", link, ".");
    } else if (event.code === 4429) {
      isOver = true;
      say("Too many others watch this robot, or too much was sent.");
    } else {
      isInterrupted = true;
      checkConnection().then(awaitConnection);
    }
  });
}

// The notice on the page is enough while the whole service does not answer, and after the end of the login, which each
// attempt would be refused for.
function awaitConnection() {
  if (!isInterrupted || socket) return;
  say(isAnswering() && !isLoggedOut() ? "The connection is lost; trying again …" : "");
  if (!isLoggedOut()) reconnectTimer = setTimeout(connect, RECONNECT_MS);
}

// What a silent network has carried late is dropped.
/** @param {WebSocket} silent */
function replaceSocket(silent) {
  socket = null;
  silent.close();
  connect();
}

const say = (/** @type {string} */ text) => {
  part("said").textContent = text;
};

/** @param {any} message */
function receive(message) {
  silence.interrupt();
  if (message.type === "frame") latest = message;
  else if (message.type === "state") showState(message);
  else if (message.type === "fall") showFall(message);
  else if (message.type === "refused") say(message.message);
  else if (message.problem) say(message.problem.detail);
}

/** @param {any} message */
function showState(message) {
  const before = state;
  state = message;
  if (message.robot && !robot) {
    robot = message.robot;
    showStrength();
    part("steering").hidden = !robot.may_steer;
    field("link").append(
      ...robot.links.map((/** @type {string} */ name) => createElement("option", { value: name }, name)),
    );
  }
  if (before?.phase === "fallen" && message.phase !== "fallen") part("fall").hidden = true;
  setActing(message.may_push && robot !== null);
  const pause = root.querySelector("[data-order=pause], [data-order=resume]");
  pause.dataset.order = message.phase === "paused" ? "resume" : "pause";
  pause.textContent = message.phase === "paused" ? "Resume" : "Pause";
  pause.disabled ||= message.phase === "fallen";
  fact("watching", counted(message.n_watching, "viewer"));
  const slow = message.phase === "running" && message.pace && message.pace < SLOW_PACE * message.settings.pace;
  fact("pace", slow ? `· runs at ${(100 * message.pace).toFixed(0)} % of real time: the computer is busy` : "");
  if (message.phase === "planning") say(`Planning: ${message.message}`);
  else if (message.phase === "failed") say(message.problem?.detail ?? message.message);
  else if (before?.phase !== message.phase || isInterrupted)
    say(message.may_push ? "" : "Your token lets you watch; pushing needs the scope submit.");
  isInterrupted = false;
  for (const slider of sliders)
    if (performance.now() > (sentUntil.get(slider) ?? 0)) showSetting(slider, message.settings[slider.dataset.setting]);
}

/** @param {PageElement} slider @param {number | null} value */
function showSetting(slider, value) {
  const name = slider.dataset.setting;
  if (value !== null) slider.value = String(value);
  root.querySelector(`[data-value="${name}"]`).textContent =
    value === null ? "as planned" : UNITS[name](Number(slider.value));
}

/** @param {boolean} may */
function setActing(may) {
  for (const group of root.querySelectorAll("[data-acting]")) group.disabled = !may;
  for (const button of orders) button.disabled = !may;
}

/** @param {{ summary: string, reasons: string[] }} fall */
function showFall(fall) {
  part("fall").hidden = false;
  part("fall-summary").textContent = fall.summary;
  part("fall-reasons").replaceChildren(...fall.reasons.map((text) => createElement("li", {}, text)));
}

// Draws the newest frame, and the marks over the scene, which move with the camera as well.
function drawAlways() {
  if (latest && robot && latest !== drawn) drawFrame(latest);
  overlay.draw();
  requestAnimationFrame(drawAlways);
}

/** @param {LiveFrame} frame */
function drawFrame(frame) {
  nodes.refreshClient();
  for (const name of Object.keys(nodes.viser.nodeRefFromName))
    if (UNUSED_NODES.some((group) => name.startsWith(group))) nodes.setScale(name, HIDDEN);
  nodes.setPose("/robot", REST, UPRIGHT);
  for (const [k, link] of robot.links.entries())
    nodes.setPose(`/robot/${link}`, frame.links[k].slice(0, 3), frame.links[k].slice(3));
  live.values = frame.com_m;
  if (!wasDrawn && field("follow").checked) camera.follow(true, 0);
  wasDrawn = true;
  camera.onFrame(0);
  drawn = frame;
  const arrows = Object.entries(frame.forces_n).map(([name, force]) => ({ at: frame.effectors_m[name], force }));
  overlay.frame = { ...frame, arrows };
  nodes.redraw();
  fact("time", `${frame.time_s.toFixed(1)} s`);
  const steps = frame.steps ? `, ${counted(frame.steps, "step")}` : "";
  const isOver = frame.plan_time_s > robot.duration_s - 0.05,
    planned = isOver ? "stands at the end of its plan" : "follows its plan";
  const doing = {
    plan: planned,
    steered: `${frame.velocity?.some((speed) => Math.abs(speed) > STILL) ? "walks" : "stands"} as steered${steps}`,
    recovery: recoveryText(frame) + steps,
    fallen: "fallen",
  };
  fact("doing", doing[frame.doing]);
  fact("velocity", frame.velocity && frame.doing !== "fallen" ? velocityText(frame.velocity) : "");
  root.dataset.shown = String(frame.time_s);
  root.dataset.doing = frame.doing;
  if (frame.push) root.dataset.pushed = String(frame.push.number);
}

/** @param {LiveFrame} frame */
function recoveryText(frame) {
  if (frame.is_planning) return "stands and plans its way on";
  return frame.not_resumed ? `stands, its plan does not go on (${frame.not_resumed})` : "steps to stay upright";
}

/** @param {[number, number, number]} values */
function velocityText([ahead, left, turn]) {
  const aside = Math.abs(left) < STILL ? "" : `, ${Math.abs(left).toFixed(2)} m/s ${left > 0 ? "left" : "right"}`;
  const turning =
    Math.abs(turn) < STILL ? "" : `, turns ${turn > 0 ? "left" : "right"} ${Math.abs(turn).toFixed(2)} rad/s`;
  return `${ahead.toFixed(2)} m/s ahead${aside}${turning}`;
}

/** @param {object} command */
function send(command) {
  if (socket?.readyState === WebSocket.OPEN) socket.send(JSON.stringify(command));
}

/** @param {number[]} impulse_ns @param {string | null} link */
function push(impulse_ns, link) {
  pushNumber += 1;
  send({ type: "push", impulse_ns, link: link || null, number: pushNumber });
}

/** @param {string} direction */
function pushTowards(direction) {
  if (!latest || part("acting").disabled) return;
  const speed = Number(field("speed").value),
    size = speed ? speed * robot.mass_kg : Number(field("impulse").value);
  push(directedImpulse(direction, Math.min(Math.abs(size), 1000), latest.links[0]), field("link").value);
}

function showStrength() {
  const speed = Number(field("speed").value);
  field("impulse").disabled = speed > 0;
  if (speed && robot) field("impulse").value = String(Math.round(speed * robot.mass_kg));
}

field("speed").addEventListener("change", showStrength);
for (const button of root.querySelectorAll("[data-push]"))
  button.addEventListener("click", () => pushTowards(button.dataset.push));
for (const button of orders) button.addEventListener("click", () => send({ type: button.dataset.order }));
for (const slider of sliders)
  slider.addEventListener("input", () => {
    const value = Number(slider.value);
    sentUntil.set(slider, performance.now() + SETTLE_MS);
    showSetting(slider, value);
    send({ type: "set", [slider.dataset.setting]: value });
  });
part("reset").addEventListener("click", () => {
  sentUntil.clear();
  send({ type: "set", friction: null, payload_kg: 0, delay_s: 0, expected_delay_s: 0, floor_time_s: 0.02, pace: 1 });
});
field("drag").addEventListener("change", () => overlay.setActive(field("drag").checked));
field("follow").addEventListener("change", () => {
  if (latest) live.values = latest.com_m;
  camera.follow(field("follow").checked, 0);
});

const keysSteer = () => Boolean(robot?.may_steer) && field("keys").checked;
new Steering(part("stick"), { send, isOn: keysSteer, isSideways: () => field("sideways").checked });

const pushByKey = (/** @type {string} */ direction) => {
  if (!keysSteer()) pushTowards(direction);
};
const press = (/** @type {string} */ order) => {
  const button = root.querySelector(`[data-order="${order}"]`);
  if (button && !button.disabled) button.click();
};
const shortcuts = new Shortcuts(
  [
    { keys: [" "], text: "Pause or resume", run: () => press(state?.phase === "paused" ? "resume" : "pause") },
    { keys: ["r"], text: "Rewind ten seconds", run: () => press("rewind") },
    { keys: ["ArrowUp"], page: true, text: "Walk ahead, or push", run: () => pushByKey("ahead") },
    { keys: ["ArrowDown"], page: true, text: "Walk back, or push", run: () => pushByKey("back") },
    { keys: ["ArrowLeft"], page: true, text: "Turn left (Shift: sideways), or push", run: () => pushByKey("left") },
    { keys: ["ArrowRight"], page: true, text: "Turn right (Shift: sideways), or push", run: () => pushByKey("right") },
    { keys: ["p"], text: "Drag from the robot to push", run: () => field("drag").click() },
    { keys: ["f"], text: "Follow the robot", run: () => field("follow").click() },
    ...CAMERA_KEYS,
  ],
  () => isReady,
);
