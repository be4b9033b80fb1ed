// The scene as it is seen now, as a PNG.

export function snapshot(viser, name) {
  const { gl } = viser.scene.__r3f.root.getState();
  const picture = document.createElement("canvas");
  [picture.width, picture.height] = [viser.canvas.width, viser.canvas.height];
  const paper = picture.getContext("2d");
  paper.fillStyle = "#fff";
  paper.fillRect(0, 0, picture.width, picture.height);
  gl.render(viser.scene, viser.camera); // a browser keeps a drawn picture only until the next one begins
  paper.drawImage(viser.canvas, 0, 0);
  return new Promise((done, fail) => {
    picture.toBlob((blob) => {
      if (!blob) return fail(new Error("The browser cannot make a picture of the scene."));
      const link = document.createElement("a");
      link.href = URL.createObjectURL(blob);
      link.download = `${name}.png`;
      link.click();
      setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
      done();
    }, "image/png");
  });
}
