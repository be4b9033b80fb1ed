// A PNG of the scene in a chosen size.
//
// A picture larger than the canvas is drawn in tiles of the size of the canvas: graphics cards limit the size of a canvas,
// and that of the scene does not change.

export const MAX_SCALE = 4; // times the size on the page

// Width and height in pixels of a picture `scale` times as large as the scene on the page.
/** @param {ViserClient} viser @param {number} scale */
export function pictureSize(viser, scale) {
  return [viser.canvas.clientWidth, viser.canvas.clientHeight].map((length) => Math.round(scale * length));
}

// Resolves to the PNG; fails if the browser cannot make a picture of that size.
/** @param {ViserClient} viser @param {number} scale @param {boolean} transparent */
export async function snapshot(viser, scale, transparent) {
  const [width, height] = pictureSize(viser, scale),
    target = document.createElement("canvas");
  Object.assign(target, { width, height });
  const context = /** @type {CanvasRenderingContext2D} */ (target.getContext("2d"));
  drawPicture(viser, context, width, height, transparent);
  const blob = await new Promise((done) => target.toBlob(done, "image/png"));
  if (!blob) throw new Error("The browser cannot make a picture of this size. Choose a smaller one.");
  return blob;
}

// Draws the scene into a canvas of any size, over the background of the page or, if `transparent`, over nothing.
/**
 * @param {ViserClient} viser
 * @param {CanvasRenderingContext2D} context
 * @param {number} width
 * @param {number} height
 * @param {boolean} transparent
 */
export function drawPicture(viser, context, width, height, transparent) {
  context.clearRect(0, 0, width, height);
  if (!transparent) {
    context.fillStyle = pageBackground(viser.canvas);
    context.fillRect(0, 0, width, height);
  }
  drawTiles(viser, context, width, height);
}

/** @param {ViserClient} viser @param {CanvasRenderingContext2D} context @param {number} width @param {number} height */
function drawTiles(viser, context, width, height) {
  const { gl } = viser.root.getState(),
    { canvas } = viser,
    camera = viser.camera.clone();
  for (let top = 0; top < height; top += canvas.height) {
    for (let left = 0; left < width; left += canvas.width) {
      camera.setViewOffset(width, height, left, top, canvas.width, canvas.height);
      gl.render(viser.scene, camera); // copied at once: the browser clears the canvas before the next frame
      context.drawImage(canvas, left, top);
    }
  }
  gl.render(viser.scene, viser.camera);
}

// The colour behind the canvas, which is transparent.
/** @param {HTMLCanvasElement} canvas */
function pageBackground(canvas) {
  const { defaultView } = canvas.ownerDocument;
  for (let node = /** @type {Element | null} */ (canvas); node; node = node.parentElement) {
    const { backgroundColor } = /** @type {Window} */ (defaultView).getComputedStyle(node);
    if (backgroundColor !== "rgba(0, 0, 0, 0)") return backgroundColor;
  }
  return "#fff";
}
