// A new element with properties (also `className`, `ariaLabel`, `role`) and children; the same for all pages.
/** @param {string} name @param {object} properties @param {(Node | string)[]} children @returns {any} */
export function createElement(name, properties = {}, ...children) {
  const node = Object.assign(document.createElement(name), properties);
  node.append(...children);
  return node;
}

// A small button with a longer label for screen readers.
/** @param {string} text @param {string} label */
export const smallButton = (text, label = text) =>
  createElement("button", { type: "button", className: "small", ariaLabel: label }, text);

// Saves a file that the page has made.
/** @param {Blob} blob @param {string} name */
export function saveBlob(blob, name) {
  const link = createElement("a", { href: URL.createObjectURL(blob), download: name });
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
}

// Writes a value into the address, so that a reload restores it; null removes it.
/** @param {string} name @param {string | number | null} value */
export function writeToAddress(name, value) {
  const url = new URL(location.href);
  if (value === null) url.searchParams.delete(name);
  else url.searchParams.set(name, String(value));
  history.replaceState(null, "", url);
}
