// Reloads the list of recordings after an upload; checked boxes and the focus are preserved.
import { localiseTimes } from "../shared/local_times.js";
import { watchScrollRegions } from "../shared/scroll_regions.js";

/** @type {Promise<void> | null} */
let pending = null,
  isOutdated = false;

// Called during a reload, it reloads once more, because the response may be older than the upload.
export async function refreshRecordings() {
  isOutdated = true;
  pending ??= fetchList().finally(() => {
    pending = null;
  });
  await pending;
}

async function fetchList() {
  while (isOutdated) {
    isOutdated = false;
    const response = await fetch(location.href, { headers: { Accept: "text/html" } }).catch(() => null);
    if (response?.ok) replaceList(new DOMParser().parseFromString(await response.text(), "text/html"));
  }
}

/** @param {Document} page */
function replaceList(page) {
  const list = document.querySelector("[data-recordings]"),
    fresh = page.querySelector("[data-recordings]");
  if (!list || !fresh) return;
  const checked = new Set([...list.querySelectorAll("input:checked")].map((box) => box.value));
  const focused = /** @type {PageElement | null} */ (
    list.contains(document.activeElement) ? document.activeElement : null
  );
  list.replaceChildren(...fresh.childNodes);
  for (const box of list.querySelectorAll("input[type=checkbox]")) box.checked = checked.has(box.value);
  /** @param {PageElement} node */
  const isSame = (node) => (focused?.value ? node.value === focused.value : node.href === focused?.href);
  if (focused) [...list.querySelectorAll(focused.tagName)].find(isSame)?.focus();
  localiseTimes(list);
  watchScrollRegions();
}
