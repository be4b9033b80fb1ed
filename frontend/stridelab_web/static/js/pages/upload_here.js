// Uploads a small recording within the viewer, which then shows it; large ones have a page with a progress bar.
import { call } from "../shared/api.js";
import { setActive } from "../shared/focus.js";
import { translate } from "../shared/translate.js";

const MAX_BYTES = 30e6;
const button = document.querySelector("[data-upload-here]");
const picker = document.querySelector("[data-upload-file]");
const status = document.querySelector("[data-said-upload]");

button?.addEventListener("click", () => picker.click());
picker?.addEventListener("change", async () => {
  const [file] = picker.files;
  picker.value = "";
  if (!file) return;
  if (file.size > MAX_BYTES) {
    status.textContent = translate(
      "%(file)s has %(size)s MB: upload files of more than %(limit)s MB on the page of recordings.",
      { file: file.name, size: Math.round(file.size / 1e6), limit: MAX_BYTES / 1e6 },
    );
    return;
  }
  const form = new FormData();
  form.append("file", file);
  setActive(button, false);
  status.textContent = translate("Uploading %(file)s…", { file: file.name });
  try {
    const { id } = await call("POST", "/recordings?reuse=true", form);
    location.assign(`/view/?recording=${encodeURIComponent(id)}`);
  } catch (error) {
    status.textContent = `${file.name}: ${/** @type {Error} */ (error).message}`;
    setActive(button, true);
  }
});
