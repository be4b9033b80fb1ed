// The keyboard shortcuts of a page: one table, which the handler runs and which the dialog behind `?` lists.
//
// A shortcut works whatever has the focus, with these exceptions:
// - text fields keep every key, and so does an open list of choices; while a dialog is open there are no shortcuts;
// - a slider keeps the arrow keys, Home and End;
// - buttons, boxes and lists that were reached by Tab keep Space, and lists the keys that choose. After a click
//   they do not: who clicks on a box and then presses Space wants to play;
// - a row with `page` does not work inside the scene, where viser's camera has these keys.

const TEXT =
  "input:not([type]), input:is([type=text], [type=search], [type=number], [type=email], [type=url], [type=tel], [type=password], [type=date], [type=time], [type=datetime-local], [type=month], [type=week]), textarea";
const ALONG = ["ArrowLeft", "ArrowRight", "ArrowUp", "ArrowDown", "Home", "End"];
const CHOOSING = [...ALONG, "PageUp", "PageDown", "Enter", "Escape"];
const NAMES = {
  " ": "Space",
  ArrowLeft: "←",
  ArrowRight: "→",
  ArrowUp: "↑",
  ArrowDown: "↓",
  PageUp: "Page Up",
  PageDown: "Page Down",
};

// What viser's camera does with keys that are pressed in the scene.
export const CAMERA_KEYS = [
  { keys: ["ArrowLeft", "ArrowRight", "ArrowUp", "ArrowDown"], text: "In the scene: turn the view" },
  { keys: ["w", "a", "s", "d"], text: "In the scene: move the view" },
];

// Whether `target` is a field in which text is typed.
export function isText(target) {
  return Boolean(target?.isContentEditable || target?.matches?.(TEXT));
}

// Whether a control keeps `key` for itself; `clicked` where it got the focus by a pointer and not by the keyboard.
export function keeps(target, key, clicked) {
  if (!target?.matches) return false;
  if (isText(target) || isOpen(target)) return true;
  if (target.matches("input[type=range]")) return ALONG.includes(key);
  if (clicked) return false;
  if (target.matches("select")) return key === " " || CHOOSING.includes(key);
  return key === " " && target.matches("button, summary, input, [role=button]");
}

// Whether a list of choices is open; a browser that does not know the selector gives its own keys to the open list alone.
function isOpen(target) {
  return CSS.supports("selector(:open)") && target.matches("select:open");
}

export class Shortcuts {
  // Of `rows`: `keys` as in KeyboardEvent.key; `text`; `run`, where it is handled here; `ctrl` with Ctrl or Cmd; `page` not
  // inside the scene; `shown` in place of the keys; `when` tells whether there is such a thing in this page.
  // `ready` tells whether the page can follow.
  constructor(rows, ready = () => true) {
    this.rows = rows;
    this.ready = ready;
    this.clicked = false;
    this.dialog = null;
    this.rows.push({ keys: ["?"], text: "This list", run: () => this.help(), always: true });
    document.addEventListener("keydown", (event) => this.onKey(event, false));
    // How the focus came to where it is.
    document.addEventListener(
      "pointerdown",
      () => {
        this.clicked = true;
      },
      true,
    );
    document.addEventListener(
      "keydown",
      (event) => {
        if (event.key === "Tab") this.clicked = false;
      },
      true,
    );
    document.querySelector("[data-shortcuts]")?.addEventListener("click", () => this.help());
  }

  // Listens inside the scene's frame too, before viser does.
  enter(frame) {
    frame.contentWindow.addEventListener("keydown", (event) => this.onKey(event, true), true);
  }

  onKey(event, inScene) {
    const row = this.rowOf(event, inScene);
    if (!row || event.defaultPrevented || document.querySelector("dialog[open]")) return;
    if (keeps(event.target, event.key, this.clicked) || !(row.always || this.ready())) return;
    event.preventDefault();
    if (inScene) event.stopImmediatePropagation();
    row.run(event);
  }

  // What a key means; Alt and AltGr only where some keyboards need them, for brackets and other signs.
  rowOf(event, inScene) {
    const graph = event.getModifierState("AltGraph"),
      ctrl = (event.ctrlKey || event.metaKey) && !graph;
    if (event.altKey && !graph && (ctrl || !/^[^\w\s]$/.test(event.key))) return undefined;
    const key = ctrl ? event.key.toLowerCase() : event.key;
    return this.listed.find(
      (row) => row.run && row.keys.includes(key) && Boolean(row.ctrl) === ctrl && !(inScene && row.page),
    );
  }

  get listed() {
    return this.rows.filter((row) => row.when?.() ?? true);
  }

  // Opens the list; the browser brings the focus back when it is closed.
  help() {
    this.dialog ??= document.body.appendChild(document.createElement("dialog"));
    const heading = element("h2", "Keyboard shortcuts"),
      list = element("dl"),
      close = element("button", "Close");
    Object.assign(heading, { id: "shortcuts-h", tabIndex: -1, autofocus: true }); // a list that is higher than the screen begins at its top
    this.dialog.setAttribute("aria-labelledby", heading.id);
    this.dialog.className = "shortcuts";
    for (const row of this.listed) {
      const keys = element("dt");
      for (const key of row.shown ?? row.keys.map((each) => NAMES[each] ?? each))
        keys.append(element("kbd", `${row.ctrl ? "Ctrl+" : ""}${key}`), " ");
      list.append(keys, element("dd", row.text));
    }
    close.addEventListener("click", () => this.dialog.close());
    const rules =
      "They work outside of text fields. Space presses a button or a box that was reached by Tab; after a click it is the shortcut.";
    const software = inSoftware()
      ? [
          element(
            "p",
            "The scene is drawn in software: this browser has no graphics card, or its hardware acceleration is off.",
            "hint",
          ),
        ]
      : [];
    this.dialog.replaceChildren(heading, list, element("p", rules, "hint"), ...software, close);
    if (!this.dialog.open) this.dialog.showModal();
  }
}

// Whether the browser draws WebGL without a graphics card.
function inSoftware() {
  const gl = document.createElement("canvas").getContext("webgl2"),
    named = gl?.getExtension("WEBGL_debug_renderer_info");
  const renderer = gl && named ? gl.getParameter(named.UNMASKED_RENDERER_WEBGL) : "";
  gl?.getExtension("WEBGL_lose_context")?.loseContext();
  return /swiftshader|llvmpipe|softpipe|software/i.test(renderer);
}

function element(name, text = "", css = "") {
  const made = document.createElement(name);
  made.textContent = text;
  if (css) made.className = css;
  return made;
}
