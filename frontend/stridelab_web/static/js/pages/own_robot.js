// A robot of one's own: its upload, the table of its card with numbers to be corrected, and its commissioning.
import { call, onClick, onSubmit, openNewJob } from "../shared/api.js";
import { createElement } from "../shared/elements.js";
import { labelOf } from "../shared/field_labels.js";

const upload = document.querySelector("form[data-add-robot]");
if (upload) {
  const choice = upload.querySelector("[data-choice]");
  const installed = upload.querySelector("[data-installed] select");
  upload.querySelector('input[name="file"]').addEventListener("change", () => offerDescriptions(choice, []));
  offerInstalled(upload, choice);
  onSubmit(upload, async (data) => {
    if (installed.value) {
      const [name, path] = JSON.parse(installed.value);
      data.set("package", name);
      data.set("description", path);
    }
    try {
      const { name } = await call("POST", "/robots", data);
      location.assign(`/robots/${encodeURIComponent(name)}`);
      return "Added.";
    } catch (error) {
      const { problem } = /** @type {{ problem?: ApiProblem | null }} */ (error);
      if (problem?.code !== "robot-several-descriptions") throw error;
      offerDescriptions(
        choice,
        (problem.errors ?? []).map((/** @type {{ where: string }} */ { where }) => where),
      );
      return "The zip holds several descriptions: choose one, and upload again.";
    }
  });
}

// Offers the robots of packages that are installed on the server in place of a file, and their names as names.
/** @param {any} form @param {any} choice */
async function offerInstalled(form, choice) {
  const file = form.querySelector('input[name="file"]');
  const name = form.querySelector('input[name="name"]');
  const label = form.querySelector("[data-installed]");
  const select = label.querySelector("select");
  const { items } = await call("GET", "/robots/packages");
  for (const one of items) {
    const options = one.descriptions.map((/** @type {string} */ path) => {
      const value = JSON.stringify([one.package, path]);
      return createElement("option", { value, title: path }, path.slice(path.lastIndexOf("/") + 1));
    });
    select.append(createElement("optgroup", { label: `${one.package} ${one.version}` }, ...options));
  }
  label.hidden = items.length === 0;
  let proposed = "";
  select.addEventListener("change", () => {
    const isInstalled = select.value !== "";
    file.disabled = isInstalled;
    file.required = !isInstalled;
    offerDescriptions(choice, []);
    if (name.value && name.value !== proposed) return;
    const path = isInstalled ? JSON.parse(select.value)[1] : "";
    const stem = path.slice(path.lastIndexOf("/") + 1).replace(/\.\w+$/, "");
    proposed = stem.toLowerCase().replace(/[^a-z0-9]+/g, "-");
    name.value = proposed;
  });
}

// Lets the user choose one of several descriptions in a zip; without any there is no choice and no field.
/** @param {any} choice @param {string[]} paths */
function offerDescriptions(choice, paths) {
  const select = choice.querySelector("select");
  choice.hidden = select.disabled = paths.length === 0;
  select.replaceChildren();
  for (const path of paths) {
    const at = path.lastIndexOf("/");
    const folder = at < 0 ? "" : ` (${path.slice(0, at)})`; // last, since a narrow field shows the beginning only
    select.append(createElement("option", { value: path }, path.slice(at + 1) + folder));
  }
  if (paths.length) select.focus();
}

const section = document.querySelector("[data-own]");
if (section) showCard(section);

/** @param {any} section */
async function showCard(section) {
  const address = `/robots/${encodeURIComponent(section.dataset.own)}`;
  const form = section.querySelector("form[data-card]");
  const commission = section.querySelector("form[data-commission]");
  const status = commission.querySelector("[data-said]");
  const own = await call("GET", `${address}/card`);
  const rows = section.querySelector("[data-fields]");
  for (const path of numberPaths(own.card)) rows.append(numberRow(own, path));
  section.querySelector("[data-use-estimates]")?.addEventListener("click", () => {
    for (const button of section.querySelectorAll("[data-estimate]")) button.click();
    form.querySelector("button:not([type])").focus();
  });
  onSubmit(form, async () => {
    await call("PUT", `${address}/card`, own.card);
    location.reload();
    return "Saved.";
  });
  for (const button of section.querySelectorAll("[data-take-back]"))
    onClick(button, status, async () => {
      const taken = own.earlier.find((/** @type {any} */ one) => String(one.version) === button.dataset.takeBack);
      await call("PUT", `${address}/card`, taken.card);
      location.reload();
    });
  onSubmit(commission, (data) =>
    openNewJob("commission-robot", {
      robot: section.dataset.own,
      samples: Number(data.get("samples")),
      search_s: Number(data.get("search_s")),
    }),
  );
  onClick(section.querySelector("[data-delete-robot]"), status, async () => {
    if (!confirm(`Delete the robot ${section.dataset.own}?`)) return;
    await call("DELETE", address);
    location.assign("/robots");
  });
}

// Paths of all numbers of a card, soles and hands first.
/** @param {any} card @returns {(string | number)[][]} */
function numberPaths(card) {
  const order = ["effectors", "reference", "limits", "rotors"];
  return order.flatMap((part) => walk(card[part] ?? {}, [part]));
}

/** @param {any} value @param {(string | number)[]} path @returns {(string | number)[][]} */
function walk(value, path) {
  if (typeof value === "number") return [path];
  if (Array.isArray(value)) return value.flatMap((item, index) => walk(item, [...path, index]));
  if (value && typeof value === "object")
    return Object.entries(value).flatMap(([key, item]) => walk(item, [...path, key]));
  return [];
}

/** @param {any} own @param {(string | number)[]} path */
function numberRow(own, path) {
  const last = path[path.length - 1];
  const holder = path.slice(0, -1).reduce((value, key) => value[key], own.card);
  const name = path.reduce((text, key) => (typeof key === "number" ? `${text}[${key}]` : `${text}.${key}`));
  const plain = path
    .filter((key) => typeof key === "string")
    .join(".")
    .replaceAll("\\", "");
  const isAssumed = own.assumed.some((/** @type {string} */ field) => plain === field || plain.startsWith(`${field}.`));
  const input = createElement("input", { type: "number", step: "any", value: String(holder[last]), required: true });
  const label = labelOf(path);
  const estimate = own.estimates[plain];
  input.setAttribute("aria-label", label);
  input.addEventListener("input", () => {
    holder[last] = input.value === "" ? null : Number(input.value);
  });
  return createElement(
    "tr",
    {},
    createElement("td", { className: "name", title: String(name) }, label),
    createElement("td", {}, input),
    createElement(
      "td",
      {},
      ...(estimate === undefined ? [isAssumed ? "assumed" : ""] : [estimateButton(input, estimate)]),
    ),
  );
}

// Takes an estimate in place of a stated value that is implausible; the service then lists the field as assumed.
/** @param {any} input @param {number} estimate */
function estimateButton(input, estimate) {
  const button = createElement("button", { type: "button", className: "small" }, `Use the estimate, ${estimate}`);
  button.dataset.estimate = "";
  button.addEventListener("click", () => {
    input.value = String(estimate);
    input.dispatchEvent(new Event("input"));
    button.replaceWith("assumed");
    input.focus();
  });
  return button;
}
