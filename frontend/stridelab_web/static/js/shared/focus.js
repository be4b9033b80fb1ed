// What keeps the keyboard focus where it is while buttons pause and rows come and go.

const CONTROLS = "a[href], button, input, select, textarea";

// Makes a button work, or do nothing for now. Unlike with `disabled`, it keeps the focus while it does nothing.
/** @param {Element} button @param {boolean} isActive */
export function setActive(button, isActive) {
  if (isActive) button.removeAttribute("aria-disabled");
  else button.setAttribute("aria-disabled", "true");
}

// Clicks on inactive buttons, by Enter too, have no effect.
globalThis.document?.addEventListener(
  "click",
  (event) => {
    if (!(event.target instanceof Element && event.target.closest("button[aria-disabled=true]"))) return;
    event.preventDefault();
    event.stopImmediatePropagation();
  },
  true,
);

// Gives the focus to the control `place` of the row `index` of a list, or to the nearest one that there is.
/** @param {Element} list @param {number} index @param {number} place @param {PageElement | null} [otherwise] if there is no row */
export function focusRow(list, index, place, otherwise = null) {
  const row = list.children[Math.min(index, list.children.length - 1)];
  const controls = /** @type {PageElement[]} */ ([...(row?.querySelectorAll(CONTROLS) ?? [])]);
  (controls[Math.min(place, controls.length - 1)] ?? otherwise)?.focus();
}

// Replaces the rows of a list; the focus stays at its place in its row.
/** @param {Element} list @param {Element[]} rows */
export function replaceRows(list, rows) {
  const focused = document.activeElement;
  const index = [...list.children].findIndex((row) => row.contains(focused));
  const place =
    index < 0 ? -1 : [...list.children[index].querySelectorAll(CONTROLS)].indexOf(/** @type {any} */ (focused));
  list.replaceChildren(...rows);
  if (place >= 0) focusRow(list, index, place);
}

// Removes a row; a focus in it goes to the row that takes its place.
/** @param {Element} row @param {PageElement | null} otherwise if it was the only row */
export function removeRow(row, otherwise) {
  const list = /** @type {Element} */ (row.parentElement);
  const index = row.contains(document.activeElement) ? [...list.children].indexOf(row) : -1;
  row.remove();
  if (index >= 0) focusRow(list, index, 0, otherwise);
}
