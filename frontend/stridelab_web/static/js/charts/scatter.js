// Shows the names of all subjects beside their marks, or only of the one under the pointer or with the focus.
const box = document.querySelector("[data-names]");
const charts = document.querySelector("[data-scatters]");
box?.addEventListener("change", () => charts.classList.toggle("named", box.checked));
