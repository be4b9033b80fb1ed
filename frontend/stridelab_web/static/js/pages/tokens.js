// Tokens, for admins: listed, made, revoked. A secret is shown once, and kept nowhere.
import { call, onSubmit } from "../shared/api.js";
import { local } from "../shared/local_times.js";

const card = document.querySelector("[data-tokens]"),
  find = (selector) => card.querySelector(selector);
const state = find("[data-state]"),
  rows = find("tbody");

/** @returns {any} */
function cell(text, tag = "td") {
  const made = document.createElement(tag);
  made.textContent = text;
  return made;
}

function until(token) {
  if (token.revoked_at) return `revoked ${local(token.revoked_at)}`;
  if (!token.expires_at) return "it is revoked";
  return `${local(token.expires_at)}${new Date(token.expires_at) < new Date() ? " (over)" : ""}`;
}

function rowOf(token) {
  const row = document.createElement("tr"),
    name = cell(token.name, "th"),
    last = cell("");
  name.scope = "row";
  row.dataset.token = token.name;
  if (!token.revoked_at) {
    const button = cell("Revoke", "button");
    button.setAttribute("aria-label", `Revoke the token of ${token.name}`);
    button.addEventListener("click", () => revoke(button, token));
    last.append(button);
  }
  row.append(name, cell(token.scope), cell(local(token.created_at)), cell(until(token)), last);
  return row;
}

// Asked twice, by the button itself: whoever uses the token is locked out at once.
async function revoke(button, token) {
  if (!button.dataset.asked) {
    button.dataset.asked = "yes";
    button.classList.add("danger");
    button.textContent = "Really revoke";
    return;
  }
  try {
    await call("DELETE", `/tokens/${token.id}`);
    await list();
  } catch (error) {
    say(error.message);
  }
}

function say(text) {
  state.textContent = text;
  state.hidden = !text;
}

async function list() {
  try {
    const { items } = await call("GET", "/tokens?limit=200");
    rows.replaceChildren(...items.map(rowOf));
    find("[data-admin]").hidden = false;
    say(items.length ? "" : "None yet: everybody would use the admin’s.");
  } catch (error) {
    say(error.message);
  }
}

onSubmit(find("[data-make]"), async (data) => {
  const days = data.get("days");
  const wanted = { name: data.get("name"), scope: data.get("scope"), days: days ? Number(days) : null };
  const made = await call("POST", "/tokens", wanted);
  find("[data-name]").textContent = made.name;
  find("[data-secret]").textContent = made.secret;
  find("[data-new]").hidden = false;
  await list();
  return "Made. Copy it now.";
});

call("GET", "/caller")
  .then(({ scope }) => (scope === "admin" ? list() : say("Your token does not manage others; an admin’s does.")))
  .catch((error) => say(error.message));
