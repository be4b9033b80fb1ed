// A small recording goes up from within the viewer, which then shows it; large ones have their page, with a bar.
import { call } from "../shared/api.js";

const AT_MOST_BYTES = 30e6;
const button = document.querySelector("[data-upload-here]");
const picker = document.querySelector("[data-upload-file]");
const said = document.querySelector("[data-said-upload]");

button?.addEventListener("click", () => picker.click());
picker?.addEventListener("change", async () => {
  const [file] = picker.files;
  picker.value = "";
  if (!file) return;
  if (file.size > AT_MOST_BYTES) {
    said.textContent = `${file.name} has ${Math.round(file.size / 1e6)} MB: files of more than ${AT_MOST_BYTES / 1e6} MB go up on the page of recordings.`;
    return;
  }
  const form = new FormData();
  form.append("file", file);
  button.disabled = true;
  said.textContent = `${file.name} goes up…`;
  try {
    const { id } = await call("POST", "/recordings?reuse=true", form);
    location.assign(`/view/?recording=${encodeURIComponent(id)}`);
  } catch (error) {
    said.textContent = `${file.name}: ${error.message}`;
    button.disabled = false;
  }
});
