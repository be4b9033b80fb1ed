// A dialog that shows the scenario as JSON, to be read, changed and stored as a whole; errors are listed with their lines.
import { createElement, smallButton } from "../shared/elements.js";

export class JsonView {
  // `read()` returns the scenario, `store(scenario)` stores one or throws with the problem.
  /** @param {PageElement} root @param {{ read: () => Scenario, store: (scenario: Scenario) => Promise<void> }} options */
  constructor(root, { read, store }) {
    const dialog = root.querySelector("[data-json]");
    this.dialog = dialog;
    this.store = store;
    this.read = read;
    this.editor = dialog.querySelector("textarea");
    this.errorList = dialog.querySelector("[data-json-faults]");
    this.status = dialog.querySelector("[data-json-said]");
    dialog.querySelector("[data-json-close]").addEventListener("click", () => dialog.close());
    dialog.querySelector("[data-json-store]").addEventListener("click", () => this.storeText());
    this.editor.addEventListener("keydown", (event) => {
      if (event.key === "Enter" && (event.ctrlKey || event.metaKey)) this.storeText();
    });
  }

  open() {
    this.editor.value = formatJson(this.read());
    this.showResult("", []);
    this.dialog.showModal();
    this.editor.focus();
    this.editor.setSelectionRange(0, 0);
    this.editor.scrollTop = 0;
  }

  async storeText() {
    let scenario;
    try {
      scenario = JSON.parse(this.editor.value);
    } catch (error) {
      const at = /position (\d+)/.exec(/** @type {Error} */ (error).message);
      const line = at ? lineAt(this.editor.value, Number(at[1])) : null;
      return this.showResult("This is not JSON.", [{ where: "", message: /** @type {Error} */ (error).message, line }]);
    }
    if (typeof scenario?.name !== "string") return this.showResult("This is not a scenario: it has no name.", []);
    this.showResult("…", []);
    try {
      await this.store(scenario);
      this.dialog.close();
    } catch (error) {
      const { problem } = /** @type {any} */ (error);
      this.showResult(
        problem?.detail ?? /** @type {Error} */ (error).message,
        (problem?.errors ?? []).map((/** @type {any} */ item) => ({
          ...item,
          line: lineOfField(this.editor.value, item.where),
        })),
      );
    }
  }

  /** @param {string} summary @param {(PlacedError & { line?: number | null })[]} errors */
  showResult(summary, errors) {
    this.status.textContent = summary;
    this.errorList.replaceChildren(
      ...errors.map(({ where, message, line }) => {
        const item = createElement("li");
        if (typeof line === "number") {
          const button = smallButton(`line ${line + 1}`);
          button.addEventListener("click", () => this.selectLine(line));
          item.append(button, " ");
        }
        if (where) item.append(createElement("b", {}, `${where}: `));
        item.append(message);
        return item;
      }),
    );
  }

  // Selects a line and scrolls to it.
  /** @param {number} line */
  selectLine(line) {
    const lines = this.editor.value.split("\n"),
      start = lines.slice(0, line).join("\n").length + (line > 0 ? 1 : 0);
    this.editor.focus();
    this.editor.setSelectionRange(start, start + lines[line].length);
    this.editor.scrollTop = (this.editor.scrollHeight / lines.length) * Math.max(line - 3, 0);
  }
}

// JSON with two spaces per level; lists of numbers are on one line.
const formatJson = (/** @type {Scenario} */ scenario) =>
  JSON.stringify(scenario, null, 2).replace(
    /\[\s+(-?[\d.e+-]+(?:,\s+-?[\d.e+-]+)*)\s+\]/g,
    (_, inner) => `[${inner.replace(/\s+/g, " ")}]`,
  );

// The line of an offset, counted from 0.
const lineAt = (/** @type {string} */ text, /** @type {number} */ offset) =>
  text.slice(0, offset).split("\n").length - 1;

// The line, counted from 0, of a field that the service names, such as phases[2].contacts[left_foot].position_m[1], or of
// its nearest parent that exists; null where no part of it does.
/** @param {string} text @param {string} field */
export function lineOfField(text, field) {
  const path = field.match(/[^.[\]]+/g) ?? [];
  const offsets = /** @type {Map<string, number>} */ (new Map());
  let value;
  try {
    value = JSON.parse(text);
    scanOffsets(text, offsets);
  } catch {
    return null;
  }
  let key = "",
    offset = /** @type {number | null} */ (null);
  for (const part of path) {
    /** @type {string | number} */
    const index = Array.isArray(value) ? itemIndex(value, part) : part;
    key += `/${index}`;
    if (!offsets.has(key)) break;
    offset = offsets.get(key) ?? null;
    value = value?.[index];
  }
  return offset === null ? null : lineAt(text, offset);
}

// The index of a list item that is named by its number, its effector or its name.
/** @param {any[]} list @param {string} part */
function itemIndex(list, part) {
  if (/^\d+$/.test(part)) return Number(part);
  return list.findIndex((item) => item?.effector === part || item?.name === part);
}

// Fills `offsets` with the offset of each value of a valid JSON text, by its path.
/** @param {string} text @param {Map<string, number>} offsets */
function scanOffsets(text, offsets) {
  let index = 0;
  const skip = () => {
    while (/\s/.test(text[index] ?? "")) index += 1;
  };
  const readString = () => {
    const start = index;
    index += 1;
    while (text[index] !== '"') index += text[index] === "\\" ? 2 : 1;
    index += 1;
    return JSON.parse(text.slice(start, index));
  };
  const readValue = (/** @type {string} */ path) => {
    skip();
    offsets.set(path, index);
    if (text[index] === '"') return void readString();
    if (text[index] !== "{" && text[index] !== "[") {
      while (index < text.length && !/[\s,\]}]/.test(text[index])) index += 1;
      return;
    }
    const isObject = text[index] === "{",
      end = isObject ? "}" : "]";
    index += 1;
    for (let k = 0; ; k += 1) {
      skip();
      if (text[index] === end) break;
      if (text[index] === ",") {
        index += 1;
        skip();
      }
      let name = String(k);
      if (isObject) {
        name = readString();
        skip();
        index += 1; // the colon
      }
      readValue(`${path}/${name}`);
    }
    index += 1;
  };
  readValue("");
}
