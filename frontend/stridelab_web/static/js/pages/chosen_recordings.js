// Actions on the recordings that are checked in the list; the list may be replaced after an upload.
import { onClick, openNewJob, startJob } from "../shared/api.js";
import { pageLanguage, translate } from "../shared/translate.js";

const list = document.querySelector("[data-recordings]");

/** @returns {string[]} */
const chosenIds = () => [...list.querySelectorAll("[name=recording]:checked")].map((box) => box.value);

function setUpActions() {
  const actions = list.querySelector("[data-chosen-actions]");
  if (!actions || actions.dataset.ready) return;
  actions.dataset.ready = "true";
  const status = actions.querySelector("[data-said]");
  const withChosen = (/** @type {(ids: string[]) => unknown} */ action) => () => {
    const ids = chosenIds();
    if (!ids.length) throw new Error(translate("Choose recordings first."));
    return action(ids);
  };
  onClick(actions.querySelector("[data-estimate-chosen]"), status, withChosen(estimateEach));
  onClick(
    actions.querySelector("[data-report-chosen]"),
    status,
    withChosen((ids) => openNewJob("gait-report", { recording_ids: ids, language: pageLanguage() })),
  );
  const all = actions.querySelector("[data-choose-all]");
  all.addEventListener("change", () => {
    for (const box of list.querySelectorAll("[name=recording]")) box.checked = all.checked;
  });
}

/** @param {string[]} ids */
async function estimateEach(ids) {
  for (const id of ids) await startJob("estimate-com", { recording_id: id });
  location.assign("/jobs?kind=estimate-com");
}

setUpActions();
new MutationObserver(setUpActions).observe(list, { childList: true });
