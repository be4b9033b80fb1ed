// Uploads files that are dropped or chosen, two at a time, each with a progress bar and a Cancel button. The reason of a
// refused file stays until it is dismissed.
import { responseJson, problemSentence } from "../shared/api.js";
import { checkConnection } from "../shared/connection_notice.js";
import { createElement, smallButton } from "../shared/elements.js";
import { removeRow } from "../shared/focus.js";
import { refreshRecordings } from "./recordings_list.js";
import { localTime } from "../shared/local_times.js";
import { translate, translateCount } from "../shared/translate.js";

const MAX_PARALLEL = 2;
// No answer, no login, too many requests, part of the service away, storage full.
const MAY_PASS_LATER = new Set([0, 401, 429, 503, 507]);
const OWN_STORAGE_FULL = "storage-limit"; // passes once something is deleted
const STORAGE_KEY = "stridelab-refused-uploads"; // of this tab, survives a reload
const zone = document.querySelector("[data-upload]");
const picker = zone.querySelector("input[type=file]");
const list = zone.querySelector("[data-uploads]");
/** @typedef {{ row: PageElement, state: PageElement, bar: HTMLProgressElement, stop: PageElement }} UploadRow */
/** @typedef {{ file: File, row: UploadRow, single: boolean, reuse: boolean, request?: XMLHttpRequest }} Upload */
/** @type {Upload[]} */
const waiting = [];
let running = 0;

for (const { name, text } of readRefusals()) showRefusal(createRow(name), name, text);

picker.addEventListener("change", () => {
  addFiles(picker.files);
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
  addFiles(event.dataTransfer?.files ?? []);
});

/** @param {ArrayLike<File> & Iterable<File>} files */
function addFiles(files) {
  const single = files.length === 1 && waiting.length + running === 0;
  for (const file of files) {
    enqueue({ file, row: createRow(file.name), single, reuse: true });
  }
  startNext();
}

/** @param {Upload} upload */
function enqueue(upload) {
  upload.row.stop.addEventListener("click", () => cancel(upload));
  waiting.push(upload);
}

/** @param {string} filename */
function createRow(filename) {
  const state = createElement("span", { className: "hint" }, translate("waiting")),
    stop = smallButton(translate("Cancel"), translate("Cancel the upload of %(file)s", { file: filename })),
    bar = createElement("progress", {
      max: 1,
      value: 0,
      ariaLabel: translate("Upload of %(file)s", { file: filename }),
    });
  const line = createElement("div", { className: "file" }, createElement("b", {}, filename), state, stop);
  const row = createElement("li", {}, line, bar);
  list.append(row);
  return { row, state, bar, stop };
}

// Cancels an upload that is waiting or in progress; once it is complete, the service processes it.
/** @param {Upload} upload */
function cancel(upload) {
  const { row } = upload,
    index = waiting.indexOf(upload);
  if (index >= 0) waiting.splice(index, 1);
  upload.request?.abort();
  removeStop(row);
  row.bar.hidden = true;
  row.state.textContent = translate("cancelled");
  row.state.setAttribute("role", "status");
}

function startNext() {
  while (running < MAX_PARALLEL && waiting.length) {
    running += 1;
    sendFile(/** @type {Upload} */ (waiting.shift())).finally(() => {
      running -= 1;
      startNext();
    });
  }
}

/** @param {Upload} upload */
function sendFile(upload) {
  const { file, row, reuse } = upload;
  return /** @type {Promise<void>} */ (
    new Promise((resolve) => {
      const form = new FormData();
      form.append("file", file);
      const request = new XMLHttpRequest();
      upload.request = request;
      request.open("POST", `/api/v1/recordings${reuse ? "?reuse=true" : ""}`);
      request.setRequestHeader("Accept", "application/json");
      request.upload.addEventListener("progress", (event) => {
        if (event.lengthComputable) row.bar.value = event.loaded / event.total;
        row.state.textContent =
          event.loaded < event.total
            ? `${Math.round((100 * event.loaded) / event.total)} %`
            : translate("checking the file…");
      });
      request.upload.addEventListener("load", () => removeStop(row));
      request.addEventListener("abort", () => resolve());
      request.addEventListener("load", () => {
        const response = responseJson(request);
        const stored = request.status === 201 && response;
        if (stored && request.getResponseHeader("Stridelab-Reused")) onKnownFile(upload, response);
        else if (stored) onStored(upload, response);
        else onFailed(upload, request.status, response);
        resolve();
      });
      request.addEventListener("error", () => {
        onFailed(upload, 0, null);
        resolve();
      });
      request.send(form);
    })
  );
}

/** @param {{ row: UploadRow, single: boolean }} options @param {any} recording */
function onStored({ row, single }, recording) {
  row.bar.value = 1;
  const remarks = recording.warnings.length;
  row.state.replaceChildren(
    linkTo(
      recording,
      remarks ? translateCount("open (%(num)s remark)", "open (%(num)s remarks)", remarks) : translate("open"),
    ),
  );
  if (single) location.assign(`/recordings/${recording.id}`);
  else refreshRecordings();
}

// The same bytes were uploaded before: offers that recording, or a second one on request.
/** @param {Upload} upload @param {any} recording */
function onKnownFile(upload, recording) {
  const { row, file, single } = upload;
  if (single) return void location.assign(`/recordings/${recording.id}?known`);
  row.bar.hidden = true;
  const uploadAgain = smallButton(
    translate("Upload as a second recording"),
    translate("Upload %(file)s as a second recording", { file: file.name }),
  );
  uploadAgain.addEventListener("click", () => sendAgain({ ...upload, single: false, reuse: false }));
  row.state.replaceChildren(
    translate("already uploaded on %(time)s:", { time: localTime(recording.created_at) }),
    " ",
    linkTo(recording, translate("open")),
    " ",
    uploadAgain,
  );
}

/** @param {any} recording @param {string} text */
function linkTo(recording, text) {
  return createElement("a", { href: `/recordings/${recording.id}` }, text);
}

// A file that may be accepted later is offered again; the refusal of any other stays on the page until it is dismissed.
/** @param {Upload} upload @param {number} status @param {any} response */
function onFailed(upload, status, response) {
  const { row, file } = upload,
    text = problemSentence(status, response);
  if (status === 0 || status === 401) checkConnection();
  if (!MAY_PASS_LATER.has(status) && response?.code !== OWN_STORAGE_FULL) {
    storeRefusals([...readRefusals(), { name: file.name, text }]);
    return showRefusal(row, file.name, text);
  }
  showRefusal(row, file.name, text);
  row.state.textContent = translate("not uploaded");
  const again = smallButton(translate("Try again"), translate("Try to upload %(file)s again", { file: file.name }));
  again.addEventListener("click", () => sendAgain(upload));
  row.state.after(again);
}

// Sends a file in a new row, whose button has the focus.
/** @param {Upload} upload */
function sendAgain(upload) {
  upload.row.row.remove();
  const again = { ...upload, row: createRow(upload.file.name) };
  again.row.stop.focus();
  enqueue(again);
  startNext();
}

/** @param {{ stop: PageElement }} options */
function removeStop({ stop }) {
  if (stop === document.activeElement) picker.focus();
  stop.remove();
}

/** @param {UploadRow} row @param {string} name @param {string} text */
function showRefusal(row, name, text) {
  removeStop(row);
  row.bar.hidden = true;
  row.state.textContent = translate("refused");
  const dismiss = smallButton(translate("Dismiss"), translate("Dismiss the refusal of %(file)s", { file: name }));
  dismiss.addEventListener("click", () => {
    const remaining = readRefusals(),
      index = remaining.findIndex(
        (/** @type {{ name: string, text: string }} */ one) => one.name === name && one.text === text,
      );
    if (index >= 0) remaining.splice(index, 1);
    storeRefusals(remaining);
    removeRow(row.row, picker);
  });
  row.state.after(dismiss);
  row.row.append(createElement("p", { className: "wrong", role: "alert" }, text));
}

function readRefusals() {
  try {
    return JSON.parse(sessionStorage.getItem(STORAGE_KEY) ?? "[]");
  } catch {
    return []; // storage is disabled, or holds something else
  }
}

/** @param {{ name: string, text: string }[]} list */
function storeRefusals(list) {
  try {
    sessionStorage.setItem(STORAGE_KEY, JSON.stringify(list));
  } catch {
    // storage is disabled: they are shown until the page is left
  }
}
