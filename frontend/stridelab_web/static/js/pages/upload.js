// Drag, drop or choose many files; two at a time go up, each with its own bar, a way to stop it and, where refused, its
// own sentence, which stays until it is dismissed.
import { answerOf, sentence } from "../shared/api.js";
import { counted } from "../shared/plurals.js";
import { refreshRecordings } from "./recordings_list.js";
import { local } from "../shared/local_times.js";

const AT_ONCE = 2;
const KEPT = "stridelab-refused-uploads"; // in this tab, also after a reload
const zone = document.querySelector("[data-upload]");
const picker = zone.querySelector("input[type=file]");
const list = zone.querySelector("[data-uploads]");
const waiting = [];
let running = 0;

for (const { name, text } of refusals()) refuse(newRow(name), name, text);

picker.addEventListener("change", () => {
  add(picker.files);
  picker.value = "";
});
for (const name of ["dragenter", "dragover"]) {
  zone.addEventListener(name, (event) => {
    event.preventDefault();
    zone.classList.add("over");
  });
}
zone.addEventListener("dragleave", (event) => {
  if (!zone.contains(/** @type {Node | null} */ (event.relatedTarget))) zone.classList.remove("over");
});
zone.addEventListener("drop", (event) => {
  event.preventDefault();
  zone.classList.remove("over");
  add(event.dataTransfer?.files ?? []);
});

function add(files) {
  const single = files.length === 1 && waiting.length + running === 0;
  for (const file of files) {
    enqueue({ file, row: newRow(file.name), single, reuse: true });
  }
  next();
}

function enqueue(upload) {
  upload.row.stop.addEventListener("click", () => cancel(upload));
  waiting.push(upload);
}

function newRow(filename) {
  const row = document.createElement("li");
  const line = document.createElement("div");
  line.className = "file";
  const name = document.createElement("b");
  name.textContent = filename;
  const state = document.createElement("span");
  state.className = "hint";
  state.textContent = "waiting";
  const stop = document.createElement("button");
  stop.type = "button";
  stop.className = "small";
  stop.textContent = "Cancel";
  stop.setAttribute("aria-label", `Cancel the upload of ${filename}`);
  line.append(name, state, stop);
  const bar = document.createElement("progress");
  bar.max = 1;
  bar.value = 0;
  bar.setAttribute("aria-label", `Upload of ${filename}`);
  row.append(line, bar);
  list.append(row);
  return { row, state, bar, stop };
}

// What has not gone up whole leaves nothing behind; once it has, the service decides, and there is nothing to cancel.
function cancel(upload) {
  const { row } = upload,
    place = waiting.indexOf(upload);
  if (place >= 0) waiting.splice(place, 1);
  upload.request?.abort();
  row.stop.remove();
  row.bar.hidden = true;
  row.state.textContent = "cancelled";
  row.state.setAttribute("role", "status");
}

function next() {
  while (running < AT_ONCE && waiting.length) {
    running += 1;
    send(waiting.shift()).finally(() => {
      running -= 1;
      next();
    });
  }
}

function send(upload) {
  const { file, row, reuse } = upload;
  return /** @type {Promise<void>} */ (
    new Promise((done) => {
      const form = new FormData();
      form.append("file", file);
      const request = new XMLHttpRequest();
      upload.request = request;
      request.open("POST", `/api/v1/recordings${reuse ? "?reuse=true" : ""}`);
      request.setRequestHeader("Accept", "application/json");
      request.upload.addEventListener("progress", (event) => {
        if (event.lengthComputable) row.bar.value = event.loaded / event.total;
        row.state.textContent =
          event.loaded < event.total ? `${Math.round((100 * event.loaded) / event.total)} %` : "checking the file…";
      });
      request.upload.addEventListener("load", () => row.stop.remove());
      request.addEventListener("abort", () => done());
      request.addEventListener("load", () => {
        const answer = answerOf(request);
        const stored = request.status === 201 && answer;
        if (stored && request.getResponseHeader("Stridelab-Reused")) known(upload, answer);
        else if (stored) accepted(upload, answer);
        else refused(upload, sentence(request.status, answer));
        done();
      });
      request.addEventListener("error", () => {
        refused(upload, sentence(0, null));
        done();
      });
      request.send(form);
    })
  );
}

function accepted({ row, single }, recording) {
  row.bar.value = 1;
  const remarks = recording.warnings.length;
  row.state.replaceChildren(linkTo(recording, remarks ? `open (${counted(remarks, "remark")})` : "open"));
  if (single) location.assign(`/recordings/${recording.id}`);
  else refreshRecordings();
}

// The same bytes were uploaded before: that recording is opened, and a second one is made only where that is asked for.
function known(upload, recording) {
  const { row, file, single } = upload;
  if (single) return void location.assign(`/recordings/${recording.id}?known`);
  row.bar.hidden = true;
  const again = smallButton("Upload as a second recording", `Upload ${file.name} as a second recording`);
  again.addEventListener("click", () => {
    row.row.remove();
    enqueue({ file, row: newRow(file.name), single: false, reuse: false });
    next();
  });
  row.state.replaceChildren(
    `already uploaded on ${local(recording.created_at)}: `,
    linkTo(recording, "open"),
    " ",
    again,
  );
}

function linkTo(recording, text) {
  const link = document.createElement("a");
  link.href = `/recordings/${recording.id}`;
  link.textContent = text;
  return link;
}

function smallButton(text, label) {
  const button = document.createElement("button");
  button.type = "button";
  button.className = "small";
  button.textContent = text;
  button.setAttribute("aria-label", label);
  return button;
}

function refused({ row, file }, text) {
  keep([...refusals(), { name: file.name, text }]);
  refuse(row, file.name, text);
}

function refuse(row, name, text) {
  row.stop.remove();
  row.bar.hidden = true;
  row.state.textContent = "refused";
  const why = document.createElement("p");
  why.className = "wrong";
  why.setAttribute("role", "alert");
  why.textContent = text;
  const dismiss = smallButton("Dismiss", `Dismiss the refusal of ${name}`);
  dismiss.addEventListener("click", () => {
    const left = refusals(),
      place = left.findIndex((one) => one.name === name && one.text === text);
    if (place >= 0) left.splice(place, 1);
    keep(left);
    row.row.remove();
  });
  row.state.after(dismiss);
  row.row.append(why);
}

function refusals() {
  try {
    return JSON.parse(sessionStorage.getItem(KEPT) ?? "[]");
  } catch {
    return []; // a browser that keeps nothing, or something else of this name
  }
}

function keep(list) {
  try {
    sessionStorage.setItem(KEPT, JSON.stringify(list));
  } catch {
    // they stay on this page alone
  }
}
