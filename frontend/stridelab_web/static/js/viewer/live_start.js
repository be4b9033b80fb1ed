// Starts a live robot and opens its page.
import { call, onSubmit } from "../shared/api.js";

for (const form of document.querySelectorAll("[data-start]"))
  onSubmit(form, async () => {
    /** @type {Api.LiveSession} */
    const session = await call("POST", "/live", Object.fromEntries(new FormData(/** @type {any} */ (form))));
    location.assign(session.page);
    return "Opening …";
  });
