// On a phone the controls lie in a sheet over the lower part of the scene (view.css): a press on its handle, or a pull, opens it.

const PULL_PX = 24;

export class Sheet {
  // `sheet` holds its handle, a button.
  constructor(sheet) {
    this.sheet = sheet;
    this.handle = sheet.querySelector("[data-sheet-handle]");
    this.from_px = 0;
    this.pulled = false;
    this.handle.addEventListener("pointerdown", (event) => {
      Object.assign(this, { from_px: event.clientY, pulled: false });
      this.handle.setPointerCapture(event.pointerId);
    });
    this.handle.addEventListener("pointermove", (event) => {
      const by_px = event.clientY - this.from_px;
      if (!this.handle.hasPointerCapture(event.pointerId) || Math.abs(by_px) < PULL_PX) return;
      this.pulled = true;
      this.put(by_px < 0);
    });
    // A pull ends with a click, too; one by the keyboard has no `detail`.
    this.handle.addEventListener("click", (event) => {
      if (!this.pulled || event.detail === 0) this.put(!this.isOpen);
      this.pulled = false;
    });
    sheet.addEventListener("keydown", (event) => {
      if (event.key !== "Escape" || event.defaultPrevented || !this.isOpen) return;
      this.put(false);
      this.handle.focus();
    });
  }

  get isOpen() {
    return this.sheet.hasAttribute("data-open");
  }

  put(open) {
    this.sheet.toggleAttribute("data-open", open);
    this.handle.setAttribute("aria-expanded", String(open));
    if (!open) this.sheet.scrollTop = 0;
  }
}

for (const sheet of document.querySelectorAll("[data-sheet]")) new Sheet(sheet);
