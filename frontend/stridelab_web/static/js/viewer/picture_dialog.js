// A dialog that saves a picture of the scene in a chosen size and with or without background.
import { saveBlob } from "../shared/elements.js";
import { setActive } from "../shared/focus.js";
import { MAX_SCALE, pictureSize, snapshot } from "./snapshot.js";
import { translate } from "../shared/translate.js";

export class PictureDialog {
  // `source.viser()` returns viser's client, `source.name()` the file name.
  /** @param {PageElement} dialog @param {{ viser(): ViserClient, name(): string }} source */
  constructor(dialog, source) {
    this.dialog = dialog;
    this.source = source;
    const part = (/** @type {string} */ name) => dialog.querySelector(`[data-${name}]`);
    this.size = part("size");
    this.transparent = part("clear");
    this.saveButton = part("save");
    this.status = part("said");
    dialog.querySelector("form").addEventListener("submit", (event) => {
      event.preventDefault();
      this.savePicture();
    });
    part("close").addEventListener("click", () => dialog.close());
  }

  // Opens the dialog with the sizes for the present window.
  open() {
    const viser = this.source.viser(),
      before = this.size.value || "1";
    const sizes = Array.from({ length: MAX_SCALE }, (_, k) => k + 1);
    this.size.replaceChildren(
      ...sizes.map(
        (scale) =>
          new Option(
            translate("%(scale)s×: %(size)s pixels", { scale, size: pictureSize(viser, scale).join(" × ") }),
            String(scale),
          ),
      ),
    );
    this.size.value = before;
    this.status.textContent = "";
    this.dialog.showModal();
  }

  async savePicture() {
    setActive(this.saveButton, false);
    this.status.textContent = translate("Drawing…");
    await new Promise((done) => setTimeout(done, 50)); // shows the text first: drawing a large picture blocks the page
    try {
      const blob = await snapshot(this.source.viser(), Number(this.size.value), this.transparent.checked);
      saveBlob(blob, `${this.source.name()}.png`);
      this.dialog.close();
    } catch (error) {
      this.status.textContent = /** @type {Error} */ (error).message;
    } finally {
      setActive(this.saveButton, true);
    }
  }
}
