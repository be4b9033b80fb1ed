// The scene as it is seen now, as a PNG of a chosen size.
//
// A picture that is larger than the drawing on the screen is drawn part by part, each as large as that drawing: graphics
// cards limit the size of a drawing, and the scene keeps its own.

export const LARGEST = 4; // times the size on the page

// Width and height in pixels of a picture `times` as large as the scene on the page.
export function sizeOf(viser, times) {
  return [viser.canvas.clientWidth, viser.canvas.clientHeight].map((length) => Math.round(times * length));
}

// Resolves to the PNG. Fails where the browser has no room for a picture of that size.
export async function snapshot(viser, times, transparent) {
  const [width, height] = sizeOf(viser, times),
    picture = document.createElement("canvas");
  Object.assign(picture, { width, height });
  const paper = /** @type {CanvasRenderingContext2D} */ (picture.getContext("2d"));
  if (!transparent) {
    paper.fillStyle = background(viser.canvas);
    paper.fillRect(0, 0, width, height);
  }
  draw(viser, paper, width, height);
  const blob = await new Promise((done) => picture.toBlob(done, "image/png"));
  if (!blob) throw new Error("The browser cannot make a picture of this size. Choose a smaller one.");
  return blob;
}

function draw(viser, paper, width, height) {
  const { gl } = viser.scene.__r3f.root.getState(),
    { canvas } = viser,
    eye = viser.camera.clone();
  for (let top = 0; top < height; top += canvas.height) {
    for (let left = 0; left < width; left += canvas.width) {
      eye.setViewOffset(width, height, left, top, canvas.width, canvas.height);
      gl.render(viser.scene, eye); // a browser keeps a drawn picture only until the next one begins
      paper.drawImage(canvas, left, top);
    }
  }
  gl.render(viser.scene, viser.camera);
}

// What the page shows behind the scene, which is see-through itself.
function background(canvas) {
  const { defaultView } = canvas.ownerDocument;
  for (let node = canvas; node; node = node.parentElement) {
    const { backgroundColor } = defaultView.getComputedStyle(node);
    if (backgroundColor !== "rgba(0, 0, 0, 0)") return backgroundColor;
  }
  return "#fff";
}
