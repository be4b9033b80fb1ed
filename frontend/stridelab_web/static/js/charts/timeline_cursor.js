// Strips of intervals beside the curves: they follow the cursor and the visible time span of the curves, and a click on a
// strip moves the cursor.
const TOLERANCE_S = 1e-6;
const strips = [...document.querySelectorAll(".strip[data-duration]")].map(readStrip);

/** @param {PageElement} root */
function readStrip(root) {
  const duration_s = Number(root.dataset.duration),
    bars = [...root.querySelectorAll("svg:not(.axis)")];
  return {
    root,
    span_s: [0, duration_s],
    cursor_s: null,
    positions: readPositions(root, duration_s),
    marks: bars.map(addCursor),
  };
}

// Positions and widths of the strip in seconds; the page has them in percent of its duration.
/** @param {PageElement} root @param {number} duration_s */
function readPositions(root, duration_s) {
  const positions = [];
  for (const node of root.querySelectorAll("rect:not(.track), line, text")) {
    for (const name of ["x", "x1", "x2", "width"]) {
      const value = node.getAttribute(name);
      if (value?.endsWith("%")) positions.push({ node, name, value_s: (parseFloat(value) / 100) * duration_s });
    }
  }
  return positions;
}

/** @param {PageElement} svg */
function addCursor(svg) {
  const mark = document.createElementNS(svg.namespaceURI, "line");
  mark.setAttribute("class", "now");
  mark.setAttribute("y2", "100%");
  svg.append(mark);
  return mark;
}

/** @param {{ span_s: number[], cursor_s: number | null, positions: any[], marks: Element[] }} strip */
function draw({ span_s: [from_s, to_s], cursor_s, positions, marks }) {
  const percent = (/** @type {number} */ length_s) => `${(100 * length_s) / (to_s - from_s)}%`;
  for (const { node, name, value_s } of positions) {
    node.setAttribute(name, percent(name === "width" ? value_s : value_s - from_s));
    // A tick of the axis is drawn completely or not at all.
    if (node.closest(".axis"))
      node.setAttribute(
        "visibility",
        value_s < from_s - TOLERANCE_S || value_s > to_s + TOLERANCE_S ? "hidden" : "visible",
      );
  }
  if (cursor_s === null) return;
  for (const mark of marks) for (const name of ["x1", "x2"]) mark.setAttribute(name, percent(cursor_s - from_s));
}

document.addEventListener("instant", ({ detail }) => {
  for (const strip of strips) draw(Object.assign(strip, { cursor_s: detail }));
});

document.addEventListener("span", ({ detail }) => {
  for (const strip of strips) draw(Object.assign(strip, { span_s: detail }));
});

for (const strip of strips) {
  strip.root.addEventListener("click", ({ target, clientX }) => {
    const svg = /** @type {Element} */ (target).closest("svg");
    if (!svg) return;
    const { left, width } = svg.getBoundingClientRect(),
      [from_s, to_s] = strip.span_s;
    document.dispatchEvent(new CustomEvent("seek", { detail: from_s + ((to_s - from_s) * (clientX - left)) / width }));
  });
}
