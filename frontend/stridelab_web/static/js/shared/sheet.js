// The sheet of controls over the scene on a phone (view.css): a press or a pull of its handle opens and closes it.

const PULL_PX = 24;

export class Sheet {
  /** @param {PageElement} sheet */
  constructor(sheet) {
    this.sheet = sheet;
    this.handle = sheet.querySelector("[data-sheet-handle]");
    this.start_px = 0;
    this.isPulled = false;
    this.handle.addEventListener("pointerdown", (event) => {
      Object.assign(this, { start_px: event.clientY, isPulled: false });
      this.handle.setPointerCapture(event.pointerId);
    });
    this.handle.addEventListener("pointermove", (event) => {
      const pull_px = event.clientY - this.start_px;
      if (!this.handle.hasPointerCapture(event.pointerId) || Math.abs(pull_px) < PULL_PX) return;
      this.isPulled = true;
      this.setOpen(pull_px < 0);
    });
    // A pull also ends with a click; a click by keyboard has no `detail`.
    this.handle.addEventListener("click", (event) => {
      if (!this.isPulled || event.detail === 0) this.setOpen(!this.isOpen);
      this.isPulled = false;
    });
    sheet.addEventListener("keydown", (event) => {
      if (event.key !== "Escape" || event.defaultPrevented || !this.isOpen) return;
      this.setOpen(false);
      this.handle.focus();
    });
  }

  get isOpen() {
    return this.sheet.hasAttribute("data-open");
  }

  /** @param {boolean} open */
  setOpen(open) {
    this.sheet.toggleAttribute("data-open", open);
    this.handle.setAttribute("aria-expanded", String(open));
    if (!open) this.sheet.scrollTop = 0;
  }
}

for (const sheet of document.querySelectorAll("[data-sheet]")) new Sheet(sheet);
