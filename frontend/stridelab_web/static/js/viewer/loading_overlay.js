// What lies over a scene until it is complete, or says why there is none.
//
// Below it the scene is out of sight (`data-held`, app.css), where viser's client draws nothing: pictures of what is not
// complete yet would cost as much as the one that is wanted.

// Takes the veil away once the whole scene, as it stands now, is drawn.
export async function lift(stage, nodes) {
  delete stage.dataset.held;
  await nodes.drawn();
  stage.querySelector("[data-veil]").hidden = true;
}

export function failed(stage, error) {
  const veil = stage.querySelector("[data-veil]");
  veil.hidden = false;
  veil.textContent = error.message;
  stage.querySelector("iframe").remove(); // viser would try again for ever
}
