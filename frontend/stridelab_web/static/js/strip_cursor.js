// The instant of the curves' cursor on the strip above them; a press on the strip moves the cursor there.
const strip = document.querySelector(".strip[data-duration]");
const duration_s = Number(strip.dataset.duration);

const marks = [...strip.querySelectorAll("svg:not(.axis)")].map((svg) => {
  const mark = document.createElementNS(svg.namespaceURI, "line");
  mark.setAttribute("class", "now");
  mark.setAttribute("y2", "100%");
  svg.append(mark);
  return mark;
});

document.addEventListener("instant", ({ detail }) => {
  const x = `${(100 * detail) / duration_s}%`;
  for (const mark of marks) {
    mark.setAttribute("x1", x);
    mark.setAttribute("x2", x);
  }
});

strip.addEventListener("click", ({ target, clientX }) => {
  const svg = target.closest("svg");
  if (!svg) return;
  const { left, width } = svg.getBoundingClientRect();
  document.dispatchEvent(new CustomEvent("seek", { detail: (duration_s * (clientX - left)) / width }));
});
