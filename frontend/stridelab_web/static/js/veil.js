// What lies over a scene until it is complete, or says why there is none.

export function failed(stage, error) {
  const veil = stage.querySelector("[data-veil]");
  veil.hidden = false;
  veil.textContent = error.message;
  stage.querySelector("iframe").remove(); // viser would try again for ever
}
