// Texts of the scripts in the language of the page. The translations are those of stridelab/translations/*.po; English needs none.

/** @typedef {string | string[]} Translation */

export const pageLanguage = () => document.documentElement.lang || "en";

// The forms of the page's language: singular first; a language without plural has one.
const rules = typeof document === "undefined" ? null : new Intl.PluralRules(pageLanguage());

/** @returns {Record<string, Translation>} */
const catalogue = () => globalThis.stridelabMessages ?? {};

/** @param {string} text @param {Record<string, unknown>} values */
function fill(text, values) {
  return text.replace(/%\((\w+)\)s/g, (place, name) => (name in values ? String(values[name]) : place));
}

// The translation of a message with values at its places `%(name)s`.
/** @param {string} message @param {Record<string, unknown>} [values] @returns {string} */
export function translate(message, values = {}) {
  const found = catalogue()[message];
  return fill(typeof found === "string" && found ? found : message, values);
}

// The plural form of a message for `num`, which is at the place `%(num)s`.
/** @param {string} one @param {string} many @param {number} num @param {Record<string, unknown>} [values] @returns {string} */
export function translateCount(one, many, num, values = {}) {
  const forms = catalogue()[one];
  const last = Array.isArray(forms) ? forms.length - 1 : 0;
  const form = Array.isArray(forms) ? forms[rules?.select(num) === "one" ? 0 : last] : "";
  return fill(form || (num === 1 ? one : many), { num, ...values });
}

// A sentence of the service in the language of the page; in English if no known sentence matches it. Of a progress
// message, "stage: activity", each part is a sentence; it is translated if all of them are.
/** @param {string} sentence @returns {string} */
export function translateServed(sentence) {
  const whole = translateSentence(sentence);
  if (whole !== null) return whole;
  const parts = sentence.split(": ").map(translateSentence);
  return parts.includes(null) ? sentence : parts.join(": ");
}

/** @param {string} sentence @returns {string | null} null if no known sentence matches */
function translateSentence(sentence) {
  for (const pattern of globalThis.stridelabSentences ?? []) {
    const match = patternOf(pattern).exec(sentence);
    if (!match) continue;
    const { checks, ...values } = match.groups ?? {};
    return translate(pattern, checks ? { checks: translateChecks(checks), ...values } : values);
  }
  return null;
}

// The checks that a verdict lists, as "a, b and 2 more".
/** @param {string} listed @returns {string} */
function translateChecks(listed) {
  const more = /^(.+) and (\d+) more$/.exec(listed);
  if (more) return translate("%(checks)s and %(number)s more", { checks: translateChecks(more[1]), number: more[2] });
  return listed
    .split(", ")
    .map((label) => translate(label))
    .join(", ");
}

/** @param {string} pattern */
function patternOf(pattern) {
  const parts = pattern.split(/%\((\w+)\)s/);
  const source = parts.map((part, k) => (k % 2 ? `(?<${part}>.+?)` : part.replace(/[.*+?^${}()|[\]\\]/g, "\\$&")));
  return new RegExp(`^${source.join("")}$`, "s");
}
