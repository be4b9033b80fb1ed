// The 3D scene beside the curves, with one cursor: the viewer in a frame, whose time follows the page's cursor and moves it.
import { createElement } from "../shared/elements.js";

const REMEMBERED = "stridelab-scene-beside",
  CURVES_INTERVAL_MS = 80;
const panel = document.querySelector("[data-beside]");
const button = document.querySelector("[data-show-beside]");

/** @type {any} */
let frame = null;
let cursor_s = NaN,
  isFromScene = false,
  drawn_ms = 0;

/** @param {boolean} on */
function show(on) {
  button.setAttribute("aria-pressed", String(on));
  panel.hidden = !on;
  panel.parentElement.classList.toggle("with-scene", on);
  if (!on) {
    frame?.remove();
    frame = null;
  } else if (!frame) {
    const at = Number.isNaN(cursor_s) ? "" : `&t=${cursor_s.toFixed(3)}`;
    frame = createElement("iframe", { src: `${panel.dataset.beside}${at}`, title: "The motion in 3D" });
    frame.addEventListener("load", () => frame.contentDocument.addEventListener("instant", followScene));
    panel.append(frame);
  }
  window.dispatchEvent(new Event("resize")); // the curves take the width that is left
}

// While the scene plays, the curves follow at a rate at which they can be drawn.
/** @param {any} event */
function followScene({ detail }) {
  if (performance.now() - drawn_ms < CURVES_INTERVAL_MS) return;
  drawn_ms = performance.now();
  isFromScene = true;
  document.dispatchEvent(new CustomEvent("seek", { detail }));
  isFromScene = false;
}

document.addEventListener("instant", ({ detail }) => {
  cursor_s = detail;
  const view = frame?.contentWindow;
  if (view && !isFromScene) view.document.dispatchEvent(new view.CustomEvent("seek", { detail }));
});

button.addEventListener("click", () => {
  const on = button.getAttribute("aria-pressed") !== "true";
  localStorage.setItem(REMEMBERED, String(on));
  show(on);
  // A scene that is out of view is not drawn, and so does not become ready.
  if (on) panel.scrollIntoView({ block: "nearest" });
});
if (localStorage.getItem(REMEMBERED) === "true") show(true);
