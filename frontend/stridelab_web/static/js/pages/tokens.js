// The tokens of the service, for admins: list, create, revoke. A secret is shown once and not stored.
import { call, onSubmit } from "../shared/api.js";
import { createElement } from "../shared/elements.js";
import { replaceRows } from "../shared/focus.js";
import { localTime } from "../shared/local_times.js";

const card = document.querySelector("[data-tokens]"),
  find = (/** @type {string} */ selector) => card.querySelector(selector);
/** @typedef {{ id: string, name: string, scope: string, created_at: string, expires_at: string | null, revoked_at: string | null }} Token */
const state = find("[data-state]"),
  rows = find("tbody");

/** @param {Token} token */
function expiryText(token) {
  if (token.revoked_at) return `revoked ${localTime(token.revoked_at)}`;
  if (!token.expires_at) return "it is revoked";
  return `${localTime(token.expires_at)}${new Date(token.expires_at) < new Date() ? " (over)" : ""}`;
}

/** @param {Token} token */
function createRow(token) {
  const texts = [token.scope, localTime(token.created_at), expiryText(token), ""];
  const cells = texts.map((text) => createElement("td", {}, text));
  if (!token.revoked_at) {
    const button = createElement("button", { ariaLabel: `Revoke the token of ${token.name}` }, "Revoke");
    button.addEventListener("click", () => revoke(button, token));
    cells[3].append(button);
  }
  const row = createElement("tr", {}, createElement("th", { scope: "row" }, token.name), ...cells);
  row.dataset.token = token.name;
  return row;
}

// The first click asks for confirmation: the token stops working at once.
/** @param {PageElement} button @param {Token} token */
async function revoke(button, token) {
  if (!button.dataset.asked) {
    button.dataset.asked = "yes";
    button.classList.add("danger");
    button.textContent = "Really revoke";
    return;
  }
  try {
    await call("DELETE", `/tokens/${token.id}`);
    await refresh();
  } catch (error) {
    setStatus(/** @type {Error} */ (error).message);
  }
}

/** @param {string} text */
function setStatus(text) {
  state.textContent = text;
  state.hidden = !text;
}

async function refresh() {
  try {
    const { items } = await call("GET", "/tokens?limit=200");
    replaceRows(rows, items.map(createRow));
    find("[data-admin]").hidden = false;
    setStatus(items.length ? "" : "No tokens yet: all users would share the admin’s.");
  } catch (error) {
    setStatus(/** @type {Error} */ (error).message);
  }
}

onSubmit(find("[data-make]"), async (data) => {
  const days = data.get("days");
  const request = { name: data.get("name"), scope: data.get("scope"), days: days ? Number(days) : null };
  const created = await call("POST", "/tokens", request);
  find("[data-name]").textContent = created.name;
  find("[data-secret]").textContent = created.secret;
  find("[data-new]").hidden = false;
  await refresh();
  return "Created. Copy it now.";
});

call("GET", "/caller")
  .then(({ scope }) =>
    scope === "admin" ? refresh() : setStatus("Your token does not manage others; an admin’s does."),
  )
  .catch((error) => setStatus(/** @type {Error} */ (error).message));
