// Tells how far the files of a robot are, and loads the page that shows it when they are there.
import { call } from "../shared/api.js";

const ASK_EVERY_MS = 500;
const root = document.querySelector("[data-preparing]");
const bar = root.querySelector("progress");
const [percent, message] = ["percent", "message"].map((name) => root.querySelector(`[data-${name}]`));

ask();

async function ask() {
  try {
    const found = await call("GET", `/robots/${root.dataset.preparing}/preparation`);
    if (found.state !== "preparing") return location.reload(); // it shows the scene, or says why there is none
    bar.value = Math.max(bar.value, Math.floor(100 * found.fraction));
    percent.textContent = String(bar.value);
    message.textContent = found.message;
  } catch (error) {
    message.textContent = error.message;
  }
  setTimeout(ask, ASK_EVERY_MS);
}
