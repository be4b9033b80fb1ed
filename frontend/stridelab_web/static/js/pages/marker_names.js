// The form that names the markers of a recording: filled with a proposal, saved as its map or stored as a marker set.
import { call, onSubmit } from "../shared/api.js";
import { createElement } from "../shared/elements.js";
import { translate, translateCount } from "../shared/translate.js";

const DOUBTFUL = 0.8;

/** @typedef {{label: string, confidence: number}} Proposed */

// The landmarks of a proposal from the least to the most certain.
/** @param {Record<string, Proposed>} landmarks @returns {[string, Proposed][]} */
export function leastCertainFirst(landmarks) {
  return Object.entries(landmarks).sort(([, one], [, other]) => one.confidence - other.confidence);
}

/** @param {number} confidence from 0 to 1 */
export function confidenceText(confidence) {
  const percent = `${Math.round(100 * confidence)} %`;
  return confidence < DOUBTFUL ? translate("%(percent)s, check", { percent }) : percent;
}

// The sentence about a proposal: how many landmarks it names, how many of them are doubtful.
/** @param {Record<string, Proposed>} landmarks @param {string[]} unassigned */
export function proposalSentence(landmarks, unassigned) {
  const named = Object.values(landmarks);
  const doubtful = named.filter((one) => one.confidence < DOUBTFUL).length;
  const proposed = translate("Proposed: %(named)s landmarks, %(doubtful)s of them to check.", {
    named: named.length,
    doubtful,
  });
  if (!unassigned.length) return proposed;
  const rest = translateCount("No landmark for %(num)s marker.", "No landmark for %(num)s markers.", unassigned.length);
  return `${proposed} ${rest}`;
}

/** @param {PageElement} root @param {string} id @param {(patch: object) => Promise<string>} save */
export function setUpMarkerNames(root, id, save) {
  /** @type {any} */
  const form = root.querySelector("[data-markers]");
  const status = form.querySelector("[data-proposed]");
  const names = () => Object.fromEntries([...new FormData(form)].filter(([, label]) => label));

  const fieldOf = (/** @type {string} */ landmark) => {
    const present = form.elements[landmark];
    if (present) return present;
    const first = form.querySelector(".fields label");
    const label = first.cloneNode(true);
    const field = label.querySelector("input");
    label.firstChild.textContent = `${landmark.replaceAll("_", " ")} `;
    field.name = landmark;
    field.defaultValue = "";
    field.placeholder = translate("missing");
    first.parentElement.append(label);
    return field;
  };

  const showProposal = (/** @type {{landmarks: Record<string, Proposed>, unassigned: string[]}} */ proposal) => {
    const fields = leastCertainFirst(proposal.landmarks).map(([landmark, proposed]) => {
      const field = fieldOf(landmark);
      const label = field.closest("label");
      field.value = proposed.label;
      label.querySelector("[data-confidence]")?.remove();
      const note = createElement("span", { className: "hint" }, confidenceText(proposed.confidence));
      note.dataset.confidence = "";
      label.append(note);
      return label;
    });
    form.querySelector(".fields").prepend(...fields);
    status.textContent = proposalSentence(proposal.landmarks, proposal.unassigned);
  };

  const propose = async () => {
    status.textContent = translate("Comparing labels, positions and motion…");
    try {
      showProposal(await call("POST", "/marker-sets/propose", { recording_id: id }));
    } catch (error) {
      status.textContent = /** @type {Error} */ (error).message;
    }
  };

  onSubmit(form, () => save({ marker_map: names() }));
  onSubmit(root.querySelector("[data-marker-set]"), async (data) => {
    const name = String(data.get("name")).trim();
    if (!name) return translate("Enter a name.");
    await call("POST", "/marker-sets", { name, landmarks: names() });
    location.reload();
    return translate("Stored.");
  });
  form.querySelector("[data-propose]").addEventListener("click", propose);
  if (form.hasAttribute("data-unnamed")) propose();
}
