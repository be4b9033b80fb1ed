// Drag, drop or choose many files; two at a time go up, each with its own bar, a way to stop it and, where refused, its
// own sentence.
import { answerOf, sentence } from "./api.js";

const AT_ONCE = 2;
const zone = document.querySelector("[data-upload]");
const picker = zone.querySelector("input[type=file]");
const list = zone.querySelector("[data-uploads]");
const waiting = [];
let running = 0;

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
  if (!zone.contains(event.relatedTarget)) zone.classList.remove("over");
});
zone.addEventListener("drop", (event) => {
  event.preventDefault();
  zone.classList.remove("over");
  add(event.dataTransfer.files);
});

function add(files) {
  const single = files.length === 1 && waiting.length + running === 0;
  for (const file of files) {
    const upload = { file, row: newRow(file), single };
    upload.row.stop.addEventListener("click", () => cancel(upload));
    waiting.push(upload);
  }
  next();
}

function newRow(file) {
  const row = document.createElement("li");
  const line = document.createElement("div");
  line.className = "file";
  const name = document.createElement("b");
  name.textContent = file.name;
  const state = document.createElement("span");
  state.className = "hint";
  state.textContent = "waiting";
  const stop = document.createElement("button");
  stop.type = "button";
  stop.className = "small";
  stop.textContent = "Cancel";
  stop.setAttribute("aria-label", `Cancel the upload of ${file.name}`);
  line.append(name, state, stop);
  const bar = document.createElement("progress");
  bar.max = 1;
  bar.value = 0;
  bar.setAttribute("aria-label", `Upload of ${file.name}`);
  row.append(line, bar);
  list.append(row);
  return { row, state, bar, stop };
}

// What has not gone up whole leaves nothing behind; once it has, the service decides, and there is nothing to cancel.
function cancel(upload) {
  const { row } = upload, place = waiting.indexOf(upload);
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
  const { file, row, single } = upload;
  return new Promise((done) => {
    const form = new FormData();
    form.append("file", file);
    const request = (upload.request = new XMLHttpRequest());
    request.open("POST", "/api/v1/recordings");
    request.setRequestHeader("Accept", "application/json");
    request.upload.addEventListener("progress", (event) => {
      if (event.lengthComputable) row.bar.value = event.loaded / event.total;
      row.state.textContent = event.loaded < event.total ? `${Math.round((100 * event.loaded) / event.total)} %` : "checking the file…";
    });
    request.upload.addEventListener("load", () => row.stop.remove());
    request.addEventListener("abort", done);
    request.addEventListener("load", () => {
      const answer = answerOf(request);
      if (request.status === 201 && answer) accepted(row, answer, single);
      else refused(row, sentence(request.status, answer));
      done();
    });
    request.addEventListener("error", () => {
      refused(row, sentence(0, null));
      done();
    });
    request.send(form);
  });
}

function accepted(row, recording, single) {
  row.bar.value = 1;
  row.state.textContent = "";
  const link = document.createElement("a");
  link.href = `/recordings/${recording.id}`;
  const remarks = recording.warnings.length;
  link.textContent = remarks ? `open (${remarks} ${remarks === 1 ? "remark" : "remarks"})` : "open";
  row.state.append(link);
  if (single) location.assign(link.href);
}

function refused(row, text) {
  row.stop.remove();
  row.bar.hidden = true;
  row.state.textContent = "refused";
  const why = document.createElement("p");
  why.className = "wrong";
  why.setAttribute("role", "alert");
  why.textContent = text;
  row.row.append(why);
}
