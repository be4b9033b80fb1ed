// The overlay that covers a scene until it is complete, or shows why it failed.
//
// Under it the scene is hidden (`data-held`, app.css), so that viser's client draws no frames of an incomplete scene.

// Removes the overlay once the scene is drawn.
/** @param {PageElement} stage @param {{ rendered(): Promise<unknown> }} nodes */
export async function hideOverlay(stage, nodes) {
  delete stage.dataset.held;
  await nodes.rendered();
  stage.querySelector("[data-veil]").hidden = true;
}

/** @param {PageElement} stage @param {Error} error */
export function showFailure(stage, error) {
  const veil = stage.querySelector("[data-veil]");
  veil.hidden = false;
  veil.textContent = error.message;
  stage.querySelector("iframe").remove(); // viser would retry without end
}
