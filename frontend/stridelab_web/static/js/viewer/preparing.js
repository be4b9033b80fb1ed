// Shows the progress of preparing the files of a robot, and reloads the page when they are ready.
import { call } from "../shared/api.js";

const POLL_MS = 500;
const root = document.querySelector("[data-preparing]");
const bar = root.querySelector("progress");
const [percent, message] = ["percent", "message"].map((name) => root.querySelector(`[data-${name}]`));

poll();

async function poll() {
  try {
    const preparation = await call("GET", `/robots/${root.dataset.preparing}/preparation`);
    if (preparation.state !== "preparing") return location.reload(); // the page shows the scene, or why it failed
    bar.value = Math.max(bar.value, Math.floor(100 * preparation.fraction));
    percent.textContent = String(bar.value);
    message.textContent = preparation.message;
  } catch (error) {
    message.textContent = /** @type {Error} */ (error).message;
  }
  setTimeout(poll, POLL_MS);
}
