// A table or a log that is larger than its place can be scrolled by keyboard too: where nothing in it takes the focus, it
// takes it itself, and says what it is. Where more of it lies to the left or the right, that edge is shaded.
let regions = [];
const watch = new ResizeObserver(() => regions.forEach(mark));
watchRegions();

// Finds the regions of the page as it is now: called again where a part of the page was replaced.
export function watchRegions() {
  watch.disconnect();
  regions = [...document.querySelectorAll(".scroll, pre.log")];
  for (const region of regions) {
    watch.observe(region);
    region.onscroll = () => shade(region);
  }
}

function shade(region) {
  const left = region.scrollLeft,
    right = region.scrollWidth - region.clientWidth - left;
  region.dataset.more = [left > 1 && "left", right > 1 && "right"].filter(Boolean).join(" ");
}

function mark(region) {
  shade(region);
  const larger = region.scrollWidth > region.clientWidth || region.scrollHeight > region.clientHeight;
  if (!larger || region.querySelector("a[href], button, input, select")) {
    for (const name of ["tabindex", "role", "aria-label"]) region.removeAttribute(name);
    return;
  }
  region.tabIndex = 0;
  region.setAttribute("role", "region");
  region.setAttribute("aria-label", nameOf(region));
}

// The nearest heading before it, with the number among those that share it: every region has a name of its own.
function nameOf(region) {
  const headings = [...document.querySelectorAll("main :is(h1, h2, h3), main summary")];
  const before = (one) =>
    headings.findLast((heading) => heading.compareDocumentPosition(one) & Node.DOCUMENT_POSITION_FOLLOWING);
  const heading = before(region),
    alike = regions.filter((one) => before(one) === heading);
  const title = heading ? heading.textContent.trim() : document.title;
  return `${title}, table or text to scroll${alike.length > 1 ? ` (${alike.indexOf(region) + 1} of ${alike.length})` : ""}`;
}
