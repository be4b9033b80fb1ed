// Starts the reproduction of one item, or of all without a result, and reports new results that the page does not show yet.
import { setActive } from "../shared/focus.js";
import { onSubmit, openNewJob, startJob } from "../shared/api.js";

const POLL_MS = 1000;
const form = document.querySelector("[data-reproduce]");
const status = form.querySelector("[data-said]");

// The server refuses draws and seeds for items that do not use them.
/** @param {any} item */
function itemInput(item) {
  const { seeds, seed } = form.elements;
  const draws = form.dataset.draws.split(" ").includes(item);
  const samples = draws || form.dataset.samples.split(" ").includes(item);
  const number = (/** @type {PageElement} */ field, /** @type {boolean} */ used) =>
    used && field.value ? Number(field.value) : null;
  return { item, seeds: number(seeds, draws), seed: number(seed, samples) };
}

onSubmit(form, (data) => openNewJob("reproduce", itemInput(data.get("item"))));

// Starts items one after the other; if the queue is full, those started so far continue.
/** @param {PageElement} button @param {string[]} items */
async function startItems(button, items) {
  setActive(button, false);
  let started = 0;
  try {
    for (const item of items) {
      status.textContent = `starting ${started + 1} of ${items.length} …`;
      await startJob("reproduce", itemInput(item));
      started += 1;
    }
    location.reload();
  } catch (error) {
    status.textContent =
      items.length > 1
        ? `${started} of ${items.length} were started. ${/** @type {Error} */ (error).message}`
        : /** @type {Error} */ (error).message;
    setActive(button, true);
  }
}

for (const button of document.querySelectorAll("[data-compute]")) {
  button.addEventListener("click", () => startItems(button, [button.dataset.compute]));
}
const all = form.querySelector("[data-missing]");
if (all) all.addEventListener("click", () => startItems(all, all.dataset.missing.split(" ")));

const unfold = document.querySelector("[data-unfold]");
if (unfold) {
  unfold.addEventListener("click", () => {
    const open = unfold.getAttribute("aria-expanded") !== "true";
    for (const item of document.querySelectorAll(".item details")) item.open = open;
    unfold.setAttribute("aria-expanded", String(open));
    unfold.textContent = open ? "Fold all" : "Unfold all";
  });
}
const linked = location.hash ? document.getElementById(location.hash.slice(1)) : null;
const folded = linked?.querySelector("details");
if (folded) folded.open = true;

// jobs.js updates the rows; a job that has finished meanwhile may have a result.
const notice = document.querySelector("[data-fresh]");
const open = [...document.querySelectorAll('tr[data-job][data-final="false"]')];
function pollOpenJobs() {
  const finished = open.filter((row) => row.dataset.final === "true").length;
  if (finished) notice.hidden = false;
  if (finished < open.length) setTimeout(pollOpenJobs, POLL_MS);
}
if (notice && open.length) pollOpenJobs();
