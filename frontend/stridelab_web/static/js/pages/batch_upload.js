// Many files and one subject table go up together; what can be read is studied, what cannot be is named first.
// A large upload is read by a job, which is followed.
import { answerOf, call, followJob, headline, onSubmit, sentence, startJob } from "../shared/api.js";

const form = document.querySelector("[data-batch]");
const bar = form.querySelector("progress");
const refused = form.querySelector("[data-refused]");
const go = form.querySelector("[data-go]");
/** @type {any} */
let uploaded = null;

function send(data) {
  return new Promise((done, failed) => {
    const request = new XMLHttpRequest();
    request.open("POST", "/api/v1/recordings/batch");
    request.setRequestHeader("Accept", "application/json");
    request.upload.addEventListener("progress", (event) => {
      if (event.lengthComputable) bar.value = event.loaded / event.total;
      if (event.loaded === event.total) form.querySelector("[data-said]").textContent = "checking the files…";
    });
    request.addEventListener("load", () => {
      const answer = answerOf(request);
      if (request.status === 201 && answer) done({ ...answer, count: answer.recordings.length });
      else if (request.status === 202 && answer) readByJob(answer.id).then(done, failed);
      else failed(new Error(sentence(request.status, answer)));
    });
    request.addEventListener("error", () => failed(new Error(sentence(0, null))));
    request.send(data);
  });
}

async function readByJob(id) {
  const said = form.querySelector("[data-said]");
  const job = await followJob(id, ({ progress }) => {
    bar.value = progress.fraction;
    said.textContent = progress.message || "waiting to be read…";
  });
  if (job.state !== "succeeded")
    throw new Error(headline(job) || `The files were not read: ${job.state.replaceAll("_", " ")}.`);
  const { summary } = await call("GET", `/jobs/${id}/result`);
  return { ...summary, count: summary.recording_ids.length };
}

async function study() {
  const job = await startJob("study-population", {
    recording_ids: uploaded.studied,
    subjects: uploaded.subjects,
    method: form.querySelector("[name=method]").value || null,
  });
  location.assign(`/population/${job.id}`);
  return "Started.";
}

onSubmit(form, async (data) => {
  const parts = new FormData(),
    files = data.getAll("file").filter((file) => file.size);
  if (!files.length) return "Choose the recordings first.";
  for (const file of files) parts.append("file", file);
  // The table is text, not a file, in this form of the interface.
  const table = /** @type {any} */ (data.get("subjects"));
  if (table.size) parts.append("subjects", await table.text());
  refused.replaceChildren();
  bar.hidden = false;
  try {
    uploaded = await send(parts);
  } finally {
    bar.hidden = true;
  }
  if (!uploaded.refused.length) return study();
  refused.append(
    ...uploaded.refused.map(({ filename, message }) => {
      const row = document.createElement("li");
      row.textContent = `${filename}: ${message}`;
      return row;
    }),
  );
  go.hidden = uploaded.studied.length === 0;
  return `${uploaded.count} uploaded, ${uploaded.refused.length} refused.`;
});

go.addEventListener("click", async () => {
  const said = form.querySelector("[data-said]");
  go.disabled = true;
  try {
    said.textContent = await study();
  } catch (error) {
    said.textContent = error.message;
  } finally {
    go.disabled = false;
  }
});
