// Makes tables and logs that overflow scrollable by keyboard: a region without focusable elements becomes focusable and gets
// a name. An edge with hidden content to its left or right is shaded. The entry of this page in the navigation, which is one
// line on narrow screens, is scrolled into view.
/** @type {PageElement[]} */
let regions = [];
const observer = new ResizeObserver(() => regions.forEach(updateRegion));
watchScrollRegions();
showCurrentEntry();

// Observes the regions of the page; to be called again after a part of the page was replaced.
export function watchScrollRegions() {
  observer.disconnect();
  regions = [...document.querySelectorAll(".scroll, pre.log")];
  for (const region of regions) {
    observer.observe(region);
    region.onscroll = () => markOverflow(region);
  }
}

/** @param {PageElement} region */
function markOverflow(region) {
  const left = region.scrollLeft,
    right = region.scrollWidth - region.clientWidth - left;
  region.dataset.more = [left > 1 && "left", right > 1 && "right"].filter(Boolean).join(" ");
}

/** @param {PageElement} region */
function updateRegion(region) {
  markOverflow(region);
  const larger = region.scrollWidth > region.clientWidth || region.scrollHeight > region.clientHeight;
  if (!larger || region.querySelector("a[href], :is(button, input, select):enabled")) {
    for (const name of ["tabindex", "role", "aria-label"]) region.removeAttribute(name);
    return;
  }
  region.tabIndex = 0;
  region.setAttribute("role", "region");
  region.setAttribute("aria-label", regionName(region));
}

// A unique name: the nearest heading before the region, with a number if several regions share it.
/** @param {PageElement} region */
function regionName(region) {
  const headings = [...document.querySelectorAll("main :is(h1, h2, h3), main summary")];
  const before = (/** @type {Node} */ one) =>
    headings.findLast((heading) => heading.compareDocumentPosition(one) & Node.DOCUMENT_POSITION_FOLLOWING);
  const heading = before(region),
    sameHeading = regions.filter((one) => before(one) === heading);
  const title = heading ? heading.textContent.trim() : document.title;
  return `${title}, table or text to scroll${sameHeading.length > 1 ? ` (${sameHeading.indexOf(region) + 1} of ${sameHeading.length})` : ""}`;
}

function showCurrentEntry() {
  const entry = /** @type {HTMLElement | null} */ (document.querySelector(".top nav [aria-current]")),
    line = entry?.parentElement;
  if (!entry || !line) return;
  line.scrollLeft = entry.offsetLeft - line.offsetLeft - (line.clientWidth - entry.offsetWidth) / 2;
}
