// The overlay that covers a scene until it is complete, or shows why it failed.
//
// Under it the scene is hidden (`data-held`, app.css), so that viser's client draws no frames of an incomplete scene.

import { translate } from "../shared/translate.js";

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

// Says which files of the result are no longer stored, so that what they contain is missing in the scene.
/** @param {PageElement} player @param {string[]} names */
export function showGoneFiles(player, names) {
  const note = player.querySelector("[data-gone]");
  const values = { names: names.join(", ") };
  note.hidden = names.length === 0;
  note.textContent = note.hidden
    ? ""
    : translate(
        "Not shown, because its file is gone: %(names)s. Restore a backup, or compute the result again.",
        values,
      );
}
