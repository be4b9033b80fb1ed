// The keyboard shortcuts of a page: one table, used by the key handler and listed in the dialog of `?`.
//
// A shortcut works whatever element has the focus, with these exceptions:
// - text fields and open selects handle every key themselves; while a dialog is open there are no shortcuts;
// - a slider handles the arrow keys, Home and End;
// - buttons, checkboxes and selects reached by Tab handle Space, and selects the keys that choose. After a click they do
//   not: Space after a click on a checkbox is meant to play;
// - a shortcut with `page` does not work inside the scene, where viser's camera uses the key.

import { createElement } from "./elements.js";
import { translate } from "./translate.js";
import { isSoftwareRendering } from "./web_gl.js";

const SOFTWARE_NOTE = translate(
  "The scene is drawn in software: this browser has no graphics card, or its hardware acceleration is off.",
);
const TEXT_FIELDS =
  "input:not([type]), input:is([type=text], [type=search], [type=number], [type=email], [type=url], [type=tel], [type=password], [type=date], [type=time], [type=datetime-local], [type=month], [type=week]), textarea";
const SLIDER_KEYS = ["ArrowLeft", "ArrowRight", "ArrowUp", "ArrowDown", "Home", "End"];
const SELECT_KEYS = [...SLIDER_KEYS, "PageUp", "PageDown", "Enter", "Escape"];
/** @type {Record<string, string>} */
const KEY_NAMES = {
  " ": translate("Space"),
  ArrowLeft: "←",
  ArrowRight: "→",
  ArrowUp: "↑",
  ArrowDown: "↓",
  PageUp: "Page Up",
  PageDown: "Page Down",
};

// Keys of viser's camera in the scene.
export const CAMERA_KEYS = [
  { keys: ["ArrowLeft", "ArrowRight", "ArrowUp", "ArrowDown"], text: translate("In the scene: turn the view") },
  { keys: ["w", "a", "s", "d"], text: translate("In the scene: move the view") },
];

// Whether `target` is a text field.
/** @param {PageElement} target */
function isTextField(target) {
  return Boolean(target?.isContentEditable || target?.matches?.(TEXT_FIELDS));
}

// Whether a control handles `key` itself.
/** @param {PageElement} target @param {string} key @param {boolean} focusedByPointer */
function handlesKey(target, key, focusedByPointer) {
  if (!target?.matches) return false;
  if (isTextField(target) || isOpenSelect(target)) return true;
  if (target.matches("input[type=range]")) return SLIDER_KEYS.includes(key);
  if (focusedByPointer) return false;
  if (target.matches("select")) return key === " " || SELECT_KEYS.includes(key);
  return key === " " && target.matches("button, summary, input, [role=button]");
}

// Whether a select is open; browsers without this selector send the keys to the open list only.
/** @param {PageElement} target */
function isOpenSelect(target) {
  return CSS.supports("selector(:open)") && target.matches("select:open");
}

export class Shortcuts {
  // Each row has `keys` as in KeyboardEvent.key and a `text`; `run` if it is handled here; `ctrl` with Ctrl or Cmd; `page` if
  // not inside the scene; `shown` to be listed instead of the keys; `when()` returns whether it applies to this page.
  // `ready()` returns whether the page handles shortcuts yet.
  /** @param {Shortcut[]} rows */
  constructor(rows, ready = () => true) {
    this.rows = rows;
    this.isReady = ready;
    this.focusedByPointer = false;
    /** @type {HTMLDialogElement | null} */
    this.dialog = null;
    this.rows.push({ keys: ["?"], text: translate("This list"), run: () => this.showHelp(), always: true });
    document.addEventListener("keydown", (event) => this.onKey(event, false));
    // Whether the focus was set by the pointer or by Tab.
    document.addEventListener(
      "pointerdown",
      () => {
        this.focusedByPointer = true;
      },
      true,
    );
    document.addEventListener(
      "keydown",
      (event) => {
        if (event.key === "Tab") this.focusedByPointer = false;
      },
      true,
    );
    document.querySelector("[data-shortcuts]")?.addEventListener("click", () => this.showHelp());
  }

  // Also handles keys inside the scene's frame, before viser does, and marks the stage while Tab has moved the focus there:
  // no selector matches a frame whose document has the focus.
  /** @param {PageElement} frame */
  listenInFrame(frame) {
    const inside = frame.contentWindow,
      mark = (/** @type {boolean} */ isFocused) => frame.parentElement.toggleAttribute("data-focused", isFocused);
    inside.addEventListener("keydown", (event) => this.onKey(event, true), true);
    inside.addEventListener("pointerdown", () => mark(false), true);
    addEventListener("blur", () => mark(document.activeElement === frame && !this.focusedByPointer));
    addEventListener("focus", () => mark(false));
  }

  /** @param {KeyboardEvent} event @param {boolean} inScene */
  onKey(event, inScene) {
    const row = this.shortcutFor(event, inScene);
    if (!row || event.defaultPrevented || document.querySelector("dialog[open]")) return;
    if (
      handlesKey(/** @type {PageElement} */ (event.target), event.key, this.focusedByPointer) ||
      !(row.always || this.isReady())
    )
      return;
    event.preventDefault();
    if (inScene) event.stopImmediatePropagation();
    row.run?.(event);
  }

  // The shortcut of a key; with Alt or AltGr only for brackets and other signs, which some keyboards need them for.
  /** @param {KeyboardEvent} event @param {boolean} inScene */
  shortcutFor(event, inScene) {
    const altGraph = event.getModifierState("AltGraph"),
      ctrl = (event.ctrlKey || event.metaKey) && !altGraph;
    if (event.altKey && !altGraph && (ctrl || !/^[^\w\s]$/.test(event.key))) return undefined;
    const key = ctrl ? event.key.toLowerCase() : event.key;
    return this.available.find(
      (row) => row.run && row.keys.includes(key) && Boolean(row.ctrl) === ctrl && !(inScene && row.page),
    );
  }

  get available() {
    return this.rows.filter((row) => row.when?.() ?? true);
  }

  // Opens the dialog; the browser restores the focus when it closes.
  showHelp() {
    this.dialog ??= document.body.appendChild(document.createElement("dialog"));
    // the heading has the focus, so that a long list starts at its top
    const heading = createElement(
        "h2",
        { id: "shortcuts-h", tabIndex: -1, autofocus: true },
        translate("Keyboard shortcuts"),
      ),
      list = createElement("dl"),
      close = createElement("button", {}, translate("Close"));
    this.dialog.setAttribute("aria-labelledby", heading.id);
    this.dialog.className = "shortcuts";
    for (const row of this.available) {
      const keys = createElement("dt");
      for (const key of row.shown ?? row.keys.map((each) => KEY_NAMES[each] ?? each))
        keys.append(createElement("kbd", {}, `${row.ctrl ? "Ctrl+" : ""}${key}`), " ");
      list.append(keys, createElement("dd", {}, row.text));
    }
    close.addEventListener("click", () => this.dialog?.close());
    const note = translate(
      "They work outside of text fields. Space presses a button or a checkbox that was reached by Tab; after a click it is the shortcut.",
    );
    const hints = [note, ...(isSoftwareRendering() ? [SOFTWARE_NOTE] : [])].map((text) =>
      createElement("p", { className: "hint" }, text),
    );
    this.dialog.replaceChildren(heading, list, ...hints, close);
    if (!this.dialog.open) this.dialog.showModal();
  }
}
