// What people read in place of the path of a number in a document: "left foot · position x [m]".

/** @type {[string, string][]} Endings of names and their units, longer ones first. */
const UNITS = [
  ["_kg_m2", "kg m²"],
  ["_rad_s", "rad/s"],
  ["_rad", "rad"],
  ["_deg", "°"],
  ["_nm", "N m"],
  ["_kg", "kg"],
  ["_m", "m"],
  ["_s", "s"],
];

/**
 * The label of a number: its keys without underscores, the axis of a vector as a letter, the unit at the end.
 * Keys of objects within `limits` and the like are names of joints or patterns, and stay as they are.
 * @param {(string | number)[]} path @returns {string}
 */
export function labelOf(path) {
  let unit = "";
  const words = path.map((key, depth) => {
    if (typeof key === "number") {
      const axes = String(path[depth - 1]).endsWith("_wxyz") ? "wxyz" : "xyz";
      return axes[key] ?? String(key + 1);
    }
    const ending = UNITS.find(([end]) => key.endsWith(end));
    if (ending && !unit) {
      unit = ending[1];
      return key.slice(0, -ending[0].length).replaceAll("_", " ");
    }
    return depth < 2 ? key.replaceAll("_", " ") : key.replaceAll("\\", "").replace(/_wxyz$/, "");
  });
  const shown = words[0] === "effectors" ? words.slice(1) : words;
  const text = shown.reduce((all, word, k) =>
    typeof path[path.length - shown.length + k] === "number" ? `${all} ${word}` : `${all} · ${word}`,
  );
  return unit ? `${text} [${unit}]` : text;
}
