// Asks for the size and the background of a picture of the scene, and saves it.
import { LARGEST, sizeOf, snapshot } from "./snapshot.js";

export class PictureDialog {
  // `of.viser()` gives viser's client, `of.name()` the name of the file.
  constructor(dialog, of) {
    this.dialog = dialog;
    this.of = of;
    const part = (name) => dialog.querySelector(`[data-${name}]`);
    this.size = part("size");
    this.clear = part("clear");
    this.save = part("save");
    this.said = part("said");
    dialog.querySelector("form").addEventListener("submit", (event) => {
      event.preventDefault();
      this.keep();
    });
    part("close").addEventListener("click", () => dialog.close());
  }

  // The sizes follow the window.
  open() {
    const viser = this.of.viser(),
      before = this.size.value || "1";
    const sizes = Array.from({ length: LARGEST }, (_, k) => k + 1);
    this.size.replaceChildren(
      ...sizes.map((times) => new Option(`${times}×: ${sizeOf(viser, times).join(" × ")} pixels`, String(times))),
    );
    this.size.value = before;
    this.said.textContent = "";
    this.dialog.showModal();
  }

  async keep() {
    this.save.disabled = true;
    this.said.textContent = "Drawing…";
    await new Promise((done) => setTimeout(done, 50)); // to be read: drawing a large picture keeps the page busy
    try {
      const blob = await snapshot(this.of.viser(), Number(this.size.value), this.clear.checked),
        link = document.createElement("a");
      link.href = URL.createObjectURL(blob);
      link.download = `${this.of.name()}.png`;
      link.click();
      setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
      this.dialog.close();
    } catch (error) {
      this.said.textContent = error.message;
    } finally {
      this.save.disabled = false;
    }
  }
}
