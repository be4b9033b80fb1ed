// Strips of intervals beside the curves: they share the curves' instant and the span of time that is shown, and a press on
// a strip moves the cursor there.
const EDGE_S = 1e-6;
const strips = [...document.querySelectorAll(".strip[data-duration]")].map(stripOf);

function stripOf(root) {
  const duration_s = Number(root.dataset.duration),
    bars = [...root.querySelectorAll("svg:not(.axis)")];
  return { root, span_s: [0, duration_s], at_s: null, placed: placedIn(root, duration_s), marks: bars.map(newMark) };
}

// Every place and width of the strip in seconds; they came in percent of its whole.
function placedIn(root, duration_s) {
  const found = [];
  for (const node of root.querySelectorAll("rect:not(.track), line, text")) {
    for (const name of ["x", "x1", "x2", "width"]) {
      const value = node.getAttribute(name);
      if (value?.endsWith("%")) found.push({ node, name, value_s: (parseFloat(value) / 100) * duration_s });
    }
  }
  return found;
}

function newMark(svg) {
  const mark = document.createElementNS(svg.namespaceURI, "line");
  mark.setAttribute("class", "now");
  mark.setAttribute("y2", "100%");
  svg.append(mark);
  return mark;
}

/** @param {{ span_s: number[], at_s: number | null, placed: any[], marks: Element[] }} strip */
function draw({ span_s: [from_s, to_s], at_s, placed, marks }) {
  const percent = (length_s) => `${(100 * length_s) / (to_s - from_s)}%`;
  for (const { node, name, value_s } of placed) {
    node.setAttribute(name, percent(name === "width" ? value_s : value_s - from_s));
    // a mark of the axis is there whole, or not at all
    if (node.closest(".axis"))
      node.setAttribute("visibility", value_s < from_s - EDGE_S || value_s > to_s + EDGE_S ? "hidden" : "visible");
  }
  if (at_s === null) return;
  for (const mark of marks) for (const name of ["x1", "x2"]) mark.setAttribute(name, percent(at_s - from_s));
}

document.addEventListener("instant", ({ detail }) => {
  for (const strip of strips) draw(Object.assign(strip, { at_s: detail }));
});

document.addEventListener("span", ({ detail }) => {
  for (const strip of strips) draw(Object.assign(strip, { span_s: detail }));
});

for (const strip of strips) {
  strip.root.addEventListener("click", ({ target, clientX }) => {
    const svg = target.closest("svg");
    if (!svg) return;
    const { left, width } = svg.getBoundingClientRect(),
      [from_s, to_s] = strip.span_s;
    document.dispatchEvent(new CustomEvent("seek", { detail: from_s + ((to_s - from_s) * (clientX - left)) / width }));
  });
}
