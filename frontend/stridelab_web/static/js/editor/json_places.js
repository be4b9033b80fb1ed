// Where in a text of JSON a field is that the service names, such as phases[2].contacts[left_foot].position_m[1].

export const lineAt = (text, offset) => text.slice(0, offset).split("\n").length - 1;

// The line of a field, counted from 0, or of the nearest one around it that is there; null where even its first part is not.
export function lineOf(text, where) {
  const path = where.match(/[^.[\]]+/g) ?? [];
  const places = new Map();
  let value;
  try {
    value = JSON.parse(text);
    scan(text, places);
  } catch {
    return null;
  }
  let key = "",
    found = null;
  for (const part of path) {
    const at = Array.isArray(value) ? indexOf(value, part) : part;
    key += `/${at}`;
    if (!places.has(key)) break;
    found = places.get(key);
    value = value?.[at];
  }
  return found === null ? null : lineAt(text, found);
}

// A place in a list by its number, or by the effector or the name that is there.
function indexOf(list, part) {
  if (/^\d+$/.test(part)) return Number(part);
  return list.findIndex((item) => item?.effector === part || item?.name === part);
}

// Notes where each value of a valid text begins, by its path.
function scan(text, places) {
  let at = 0;
  const skip = () => {
    while (/\s/.test(text[at] ?? "")) at += 1;
  };
  const string = () => {
    const start = at;
    at += 1;
    while (text[at] !== '"') at += text[at] === "\\" ? 2 : 1;
    at += 1;
    return JSON.parse(text.slice(start, at));
  };
  const value = (path) => {
    skip();
    places.set(path, at);
    if (text[at] === '"') return void string();
    if (text[at] !== "{" && text[at] !== "[") {
      while (at < text.length && !/[\s,\]}]/.test(text[at])) at += 1;
      return;
    }
    const named = text[at] === "{",
      end = named ? "}" : "]";
    at += 1;
    for (let k = 0; ; k += 1) {
      skip();
      if (text[at] === end) break;
      if (text[at] === ",") {
        at += 1;
        skip();
      }
      let name = k;
      if (named) {
        name = string();
        skip();
        at += 1; // the colon
      }
      value(`${path}/${name}`);
    }
    at += 1;
  };
  value("");
}
