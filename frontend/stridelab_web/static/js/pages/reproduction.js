// Starts computations: of one item, or of all that have none yet; says when a result came in that is not on the page.
import { onSubmit, startJob } from "../shared/api.js";

const EVERY_MS = 1000;
const form = document.querySelector("[data-reproduce]");
const said = form.querySelector("[data-said]");

function asked(item) {
  const seeds = form.elements.seeds.value;
  return startJob("reproduce", { item, seeds: seeds ? Number(seeds) : null });
}

onSubmit(form, async (data) => {
  const job = await asked(data.get("item"));
  location.assign(`/jobs/${job.id}`);
  return "Started.";
});

// One after the other: where the queue is full, what was taken goes on, and the rest can be asked for later.
async function start(button, items) {
  button.disabled = true;
  let taken = 0;
  try {
    for (const item of items) {
      said.textContent = `asking for ${taken + 1} of ${items.length} …`;
      await asked(item);
      taken += 1;
    }
    location.reload();
  } catch (error) {
    said.textContent = items.length > 1 ? `${taken} of ${items.length} are asked for. ${error.message}` : error.message;
    button.disabled = false;
  }
}

for (const button of document.querySelectorAll("[data-compute]")) {
  button.addEventListener("click", () => start(button, [button.dataset.compute]));
}
const all = form.querySelector("[data-missing]");
if (all) all.addEventListener("click", () => start(all, all.dataset.missing.split(" ")));

const unfold = document.querySelector("[data-unfold]");
if (unfold) {
  unfold.addEventListener("click", () => {
    const open = unfold.getAttribute("aria-expanded") !== "true";
    for (const item of document.querySelectorAll("details.item")) item.open = open;
    unfold.setAttribute("aria-expanded", String(open));
    unfold.textContent = open ? "Fold all" : "Unfold all";
  });
}
const linked = location.hash && document.getElementById(location.hash.slice(1));
if (linked instanceof HTMLDetailsElement) linked.open = true;

// jobs.js follows the rows; whatever was open and is over may have a result.
const fresh = document.querySelector("[data-fresh]");
const open = [...document.querySelectorAll('tr[data-job][data-final="false"]')];
function look() {
  const over = open.filter((row) => row.dataset.final === "true").length;
  if (over) fresh.hidden = false;
  if (over < open.length) setTimeout(look, EVERY_MS);
}
if (fresh && open.length) look();
