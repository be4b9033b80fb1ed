// Shows the names of all people beside their marks, or only of the one that is pointed at or reached.
const box = document.querySelector("[data-names]");
const charts = document.querySelector("[data-scatters]");
box?.addEventListener("change", () => charts.classList.toggle("named", box.checked));
