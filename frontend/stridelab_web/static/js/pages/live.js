// Shows an open stream of markers: margins, numbers and two pictures, drawn anew for every picture that arrives. Without
// a stream it looks for one every second.
import { call } from "../shared/api.js";
import { onColourScheme } from "../shared/colours.js";
import { checkConnection, isAnswering, isLoggedOut, onRestored } from "../shared/connection_notice.js";
import { createElement } from "../shared/elements.js";
import { drawBase, drawBody } from "./live_drawing.js";
import { describeMargin, describeMissing, standing } from "./live_text.js";
import { Silence } from "../shared/silence.js";
import { translate } from "../shared/translate.js";

const POLL_MS = 1000;
const QUIET_MS = 3000; // a sender may pause, too
const TEXT_MS = 200;
const said = document.querySelector("[data-said]");
const choice = document.querySelector("[data-choice]");
const streams = document.querySelector("[data-streams]");
const how = document.querySelector("[data-how]");
const answerPart = /** @type {HTMLElement} */ (document.querySelector("[data-answer]"));
const body = /** @type {any} */ (document.querySelector("[data-body]"));
const base = /** @type {any} */ (document.querySelector("[data-base]"));

/** @type {WebSocket | null} */
let socket = null;
let watched = "";
/** @type {any} */
let latest = null;
let asked = false;
let written = 0;
let lookTimer = 0;
const silence = new Silence(QUIET_MS, () => socket && checkConnection());

const show = (/** @type {string} */ name, /** @type {string} */ text) => {
  document.querySelector(`[data-fact="${name}"]`).textContent = text;
};

/** @param {any} answer */
function writeNumbers(answer) {
  show("height", answer.height_m === null ? "–" : `${(100 * answer.height_m).toFixed(1)} cm`);
  show("speed", answer.speed_m_s === null ? "–" : `${answer.speed_m_s.toFixed(2)} m/s`);
  show("sd", answer.com_sd_m === null ? "–" : `${(1000 * Math.max(...answer.com_sd_m)).toFixed(0)} mm`);
  show("feet", standing(answer.contact));
  show("time", `${answer.t_s.toFixed(2)} s`);
  document.querySelector("[data-missing]").textContent = describeMissing(answer);
}

/** @param {any} answer */
function writeMargins(answer) {
  for (const axis of /** @type {("ap" | "ml")[]} */ (["ml", "ap"])) {
    const part = document.querySelector(`[data-margin="${axis}"]`);
    const shown = describeMargin(axis, answer);
    part.dataset.state = shown.state;
    part.querySelector("[data-value]").textContent = shown.text;
    part.querySelector("[data-verdict]").textContent = shown.verdict;
    Object.assign(part.querySelector(".margin-bar i").style, { left: `${shown.left}%`, width: `${shown.width}%` });
  }
}

function draw() {
  asked = false;
  if (!latest) return;
  answerPart.hidden = false;
  const view = document.querySelector("[name=view]:checked").value;
  drawBody(body, latest, view);
  drawBase(base, latest);
  const now = performance.now();
  if (now - written >= TEXT_MS) {
    written = now;
    writeMargins(latest.answer);
    writeNumbers(latest.answer);
  }
  body.dataset.shown = String(latest.answer.t_s);
}

function redraw() {
  if (asked) return;
  asked = true;
  requestAnimationFrame(draw);
}

/** @param {Api.LiveStreams["items"][number]} item */
function watch(item) {
  watched = item.stream_id;
  const scheme = location.protocol === "https:" ? "wss" : "ws";
  const opened = new WebSocket(`${scheme}://${location.host}/api/v1/stream/markers/${watched}`);
  let seen = false;
  socket = opened;
  const stream = item.title || translate("A stream");
  const values = { stream, rate: item.rate_hz, markers: item.marker_set };
  said.textContent = translate("%(stream)s: %(rate)s frames per second, marker set %(markers)s.", values);
  opened.addEventListener("message", (message) => {
    if (socket !== opened) return;
    silence.interrupt();
    seen = true;
    latest = JSON.parse(message.data);
    if (latest.problem) {
      said.textContent = latest.problem.detail;
      latest = null;
    } else redraw();
  });
  opened.addEventListener("close", async (event) => {
    if (socket !== opened) return;
    socket = null;
    watched = "";
    if (event.code !== 1000) await checkConnection();
    if (event.code === 1000) said.textContent = translate("The stream has ended. Its last frame is shown.");
    else if (!seen && event.code === 1006 && isConnected())
      said.textContent = translate("The service refuses to show the stream: that needs a token of scope submit.");
    lookLater();
  });
}

// Whether what goes wrong is not said by the notice of the page.
const isConnected = () => isAnswering() && !isLoggedOut();

// After the end of the login each look would be refused, until the reader has logged in again.
function lookLater() {
  clearTimeout(lookTimer);
  if (!isLoggedOut()) lookTimer = setTimeout(look, POLL_MS);
}

async function look() {
  if (socket) return;
  /** @type {Api.LiveStreams["items"]} */
  let items = [];
  try {
    items = (await call("GET", "/stream/markers")).items;
  } catch (error) {
    await checkConnection();
    if (isConnected()) said.textContent = /** @type {Error} */ (error).message;
  }
  list(items);
  how.open = how.open && !items.length;
  if (items.length) watch(items[0]);
  else {
    if (!latest && isConnected()) said.textContent = translate("No stream is open.");
    lookLater();
  }
}

/** @param {Api.LiveStreams["items"]} items */
function list(items) {
  choice.hidden = items.length < 2;
  const name = (/** @type {Api.LiveStreams["items"][number]} */ item) => item.title || item.stream_id;
  streams.replaceChildren(...items.map((item) => createElement("option", { value: item.stream_id }, name(item))));
  streams.value = watched || (items[0]?.stream_id ?? "");
}

streams.addEventListener("focus", async () => list((await call("GET", "/stream/markers")).items));
streams.addEventListener("change", async () => {
  const item = (await call("GET", "/stream/markers")).items.find(
    (/** @type {any} */ one) => one.stream_id === streams.value,
  );
  if (!item) return;
  const before = socket;
  watch(item);
  before?.close();
});
for (const view of document.querySelectorAll("[name=view]")) view.addEventListener("change", redraw);
new ResizeObserver(redraw).observe(body);
onColourScheme(redraw);
onRestored(() => {
  const silent = socket;
  socket = null;
  silent?.close();
  clearTimeout(lookTimer);
  look();
});
look();
