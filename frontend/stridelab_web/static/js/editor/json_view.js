// The scenario as JSON in a dialog: read it, change it, and store it as a whole; what is wrong is named field by field.
import { lineAt, lineOf } from "./json_places.js";

export class JsonView {
  // `read()` gives the scenario, `store(body)` keeps another one or throws with what is wrong.
  constructor(root, { read, store }) {
    const dialog = root.querySelector("[data-json]");
    this.dialog = dialog;
    this.store = store;
    this.read = read;
    this.text = dialog.querySelector("textarea");
    this.faults = dialog.querySelector("[data-json-faults]");
    this.said = dialog.querySelector("[data-json-said]");
    root.querySelector("[data-json-open]").addEventListener("click", () => this.open());
    dialog.querySelector("[data-json-close]").addEventListener("click", () => dialog.close());
    dialog.querySelector("[data-json-store]").addEventListener("click", () => this.apply());
    this.text.addEventListener("keydown", (event) => {
      if (event.key === "Enter" && (event.ctrlKey || event.metaKey)) this.apply();
    });
  }

  open() {
    this.text.value = written(this.read());
    this.tell("", []);
    this.dialog.showModal();
    this.text.focus();
    this.text.setSelectionRange(0, 0);
    this.text.scrollTop = 0;
  }

  async apply() {
    let body;
    try {
      body = JSON.parse(this.text.value);
    } catch (error) {
      const at = /position (\d+)/.exec(error.message);
      const line = at ? lineAt(this.text.value, Number(at[1])) : null;
      return this.tell("This is not JSON.", [{ where: "", message: error.message, line }]);
    }
    if (typeof body?.name !== "string") return this.tell("This is not a scenario: it has no name.", []);
    this.tell("…", []);
    try {
      await this.store(body);
      this.dialog.close();
    } catch (error) {
      const { problem } = error;
      this.tell(
        problem?.detail ?? error.message,
        (problem?.errors ?? []).map((item) => ({ ...item, line: lineOf(this.text.value, item.where) })),
      );
    }
  }

  tell(said, faults) {
    this.said.textContent = said;
    this.faults.replaceChildren(
      ...faults.map(({ where, message, line }) => {
        const item = document.createElement("li");
        if (line !== null) {
          const button = document.createElement("button");
          button.type = "button";
          button.className = "small";
          button.textContent = `line ${line + 1}`;
          button.addEventListener("click", () => this.goto(line));
          item.append(button, " ");
        }
        if (where) {
          const name = document.createElement("b");
          name.textContent = `${where}: `;
          item.append(name);
        }
        item.append(message);
        return item;
      }),
    );
  }

  // Selects a line and brings it into sight.
  goto(line) {
    const lines = this.text.value.split("\n"),
      start = lines.slice(0, line).join("\n").length + (line > 0 ? 1 : 0);
    this.text.focus();
    this.text.setSelectionRange(start, start + lines[line].length);
    this.text.scrollTop = (this.text.scrollHeight / lines.length) * Math.max(line - 3, 0);
  }
}

// Two blanks a level; lists of numbers on one line.
const written = (body) =>
  JSON.stringify(body, null, 2).replace(
    /\[\s+(-?[\d.e+-]+(?:,\s+-?[\d.e+-]+)*)\s+\]/g,
    (_, inner) => `[${inner.replace(/\s+/g, " ")}]`,
  );
