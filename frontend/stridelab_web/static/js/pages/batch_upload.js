// Uploads many files with a subject table and starts a study of the readable ones; refused files are listed first. A large
// upload is read by a job, which is followed.
import {
  responseJson,
  call,
  followJob,
  jobHeadline,
  onClick,
  onSubmit,
  openNewJob,
  problemSentence,
} from "../shared/api.js";
import { createElement } from "../shared/elements.js";
import { translate, translateServed } from "../shared/translate.js";

const form = document.querySelector("[data-batch]");
const bar = form.querySelector("progress");
const refused = form.querySelector("[data-refused]");
const continueButton = form.querySelector("[data-go]");
/** @type {any} */
let uploaded = null;

/** @param {FormData} data */
function upload(data) {
  return new Promise((resolve, reject) => {
    const request = new XMLHttpRequest();
    request.open("POST", "/api/v1/recordings/batch");
    request.setRequestHeader("Accept", "application/json");
    request.upload.addEventListener("progress", (event) => {
      if (event.lengthComputable) bar.value = event.loaded / event.total;
      if (event.loaded === event.total)
        form.querySelector("[data-said]").textContent = translate("checking the files…");
    });
    request.addEventListener("load", () => {
      const response = responseJson(request);
      if (request.status === 201 && response) resolve({ ...response, count: response.recordings.length });
      else if (request.status === 202 && response) readByJob(response.id).then(resolve, reject);
      else reject(new Error(problemSentence(request.status, response)));
    });
    request.addEventListener("error", () => reject(new Error(problemSentence(0, null))));
    request.send(data);
  });
}

/** @param {string} id */
async function readByJob(id) {
  const status = form.querySelector("[data-said]");
  const job = await followJob(id, ({ progress }) => {
    bar.value = progress.fraction;
    status.textContent = translateServed(progress.text || progress.message) || translate("waiting to be read…");
  });
  if (job.state !== "succeeded")
    throw new Error(jobHeadline(job) || `The files were not read: ${job.state.replaceAll("_", " ")}.`);
  const { summary } = await call("GET", `/jobs/${id}/result`);
  return { ...summary, count: summary.recording_ids.length };
}

function startStudy() {
  const method = form.querySelector("[name=method]").value || null;
  const input = { recording_ids: uploaded.studied, subjects: uploaded.subjects, method };
  return openNewJob("study-population", input, "/population");
}

onSubmit(form, async (data) => {
  const payload = new FormData(),
    files = /** @type {any[]} */ (data.getAll("file")).filter((file) => file.size);
  if (!files.length) return translate("Choose the recordings first.");
  for (const file of files) payload.append("file", file);
  // The service takes the table as text, not as a file.
  const table = /** @type {any} */ (data.get("subjects"));
  if (table.size) payload.append("subjects", await table.text());
  refused.replaceChildren();
  bar.hidden = false;
  try {
    uploaded = await upload(payload);
  } finally {
    bar.hidden = true;
  }
  if (!uploaded.refused.length) return startStudy();
  refused.append(
    ...uploaded.refused.map((/** @type {{ filename: string, message: string }} */ { filename, message }) =>
      createElement("li", {}, `${filename}: ${message}`),
    ),
  );
  continueButton.hidden = uploaded.studied.length === 0;
  return translate("%(count)s uploaded, %(refused)s refused.", {
    count: uploaded.count,
    refused: uploaded.refused.length,
  });
});

onClick(continueButton, form.querySelector("[data-said]"), startStudy);
