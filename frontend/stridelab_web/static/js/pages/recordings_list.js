// The list of recordings, read anew after an upload; what was ticked in it and what has the focus stays so.
import { localise } from "../shared/local_times.js";
import { watchRegions } from "../shared/scroll_regions.js";

/** @type {Promise<void> | null} */
let reading = null,
  again = false;

// Called while the list is being read, it reads it once more: the answer may be older than the upload.
export async function refreshRecordings() {
  again = true;
  reading ??= readAll().finally(() => (reading = null));
  await reading;
}

async function readAll() {
  while (again) {
    again = false;
    const answer = await fetch(location.href, { headers: { Accept: "text/html" } }).catch(() => null);
    if (answer?.ok) replace(new DOMParser().parseFromString(await answer.text(), "text/html"));
  }
}

function replace(page) {
  const list = document.querySelector("[data-recordings]"),
    fresh = page.querySelector("[data-recordings]");
  if (!list || !fresh) return;
  const ticked = new Set([...list.querySelectorAll("input:checked")].map((box) => box.value));
  const focused = /** @type {PageElement | null} */ (
    list.contains(document.activeElement) ? document.activeElement : null
  );
  list.replaceChildren(...fresh.childNodes);
  for (const box of list.querySelectorAll("input[type=checkbox]")) box.checked = ticked.has(box.value);
  const same = (node) => (focused?.value ? node.value === focused.value : node.href === focused?.href);
  if (focused) [...list.querySelectorAll(focused.tagName)].find(same)?.focus();
  localise(list);
  watchRegions();
}
