// One figure of stacked curves: one time axis, so zoom and cursor are shared by construction.
/* global Plotly */
const BLUE = "#0b5c9c", ORANGE = "#c06a00", BAND = "rgba(11,92,156,0.22)", SHADE = "rgba(11,92,156,0.09)";
const AXES = { x: "#0b5c9c", y: "#c06a00", z: "#56616c" };
const ROW_PX = 170, GAP_PX = 26, TOP_PX = 10, BOTTOM_PX = 46, LEGEND_PX = 62;

const box = document.getElementById("plots");
const cursor = document.getElementById("cursor");
const readout = document.getElementById("readout");
const answer = await fetch(box.dataset.plots);
if (answer.ok) draw(await answer.json());
else box.textContent = "The curves could not be read.";

function rowsOf(columns) {
  const rows = [];
  for (const axis of ["x", "y", "z"]) {
    if (columns[`${axis}_m`]) rows.push({ title: `CoM ${axis} [m]`, traces: comTraces(columns, axis) });
  }
  const three = (title, name, dash) => {
    const traces = ["x", "y", "z"].filter((axis) => columns[name(axis)]).map((axis) => ({
      name: axis, y: columns[name(axis)], line: { color: AXES[axis], width: 1.6, dash: dash[axis] }, showlegend: false, key: name(axis),
    }));
    if (traces.length) rows.push({ title, traces, axes: true });
  };
  const dash = { x: "solid", y: "dash", z: "dot" };
  three("Velocity [m/s]", (axis) => `v${axis}_m_s`, dash);
  three("Ground reaction force [N]", (axis) => `force_${axis}_n`, dash);
  return rows;
}

function comTraces(columns, axis) {
  const y = columns[`${axis}_m`], sd = columns[`sd_${axis}_m`], geometry = columns[`geometry_${axis}_m`];
  const traces = [];
  if (sd) {
    const edge = (sign) => y.map((v, k) => (v === null || sd[k] === null ? null : v + sign * 1.96 * sd[k]));
    const line = { width: 0, color: BLUE };
    traces.push({ y: edge(-1), line, hoverinfo: "skip" }, { y: edge(1), line, fill: "tonexty", fillcolor: BAND, hoverinfo: "skip" });
  }
  if (geometry) traces.push({ name: "markers only", y: geometry, line: { color: ORANGE, width: 1.4, dash: "dash" }, key: `geometry_${axis}_m` });
  traces.push({ name: "fused", y, line: { color: BLUE, width: 2 }, key: `${axis}_m` });
  return traces;
}

function draw(data) {
  const { columns, window_s: [t0, t1] } = data;
  const t = columns.time_s;
  const rows = rowsOf(columns);
  const height = TOP_PX + BOTTOM_PX + rows.length * ROW_PX;
  const inner = height - TOP_PX - BOTTOM_PX;
  const traces = [], annotations = [];
  const layout = {
    height, margin: { l: 74, r: 16, t: TOP_PX, b: BOTTOM_PX }, showlegend: false, hovermode: "x", hoversubplots: "axis", dragmode: "zoom",
    paper_bgcolor: "#fff", plot_bgcolor: "#fff", font: { family: "system-ui, DejaVu Sans, sans-serif", size: 12, color: "#1c2733" },
    xaxis: { title: { text: "time [s]" }, range: [t[0], t[t.length - 1]], gridcolor: "#edf1f4", zeroline: false, showspikes: true, spikemode: "across", spikethickness: 1, spikecolor: "#8b98a5", spikedash: "solid", spikesnap: "cursor", anchor: "free", position: 0 },
    shapes: [
      { type: "rect", xref: "x", yref: "paper", x0: t0, x1: t1, y0: 0, y1: 1, fillcolor: SHADE, line: { width: 0 }, layer: "below" },
      { type: "line", xref: "x", yref: "paper", x0: t0, x1: t0, y0: 0, y1: 1, line: { color: ORANGE, width: 1.5 } },
    ],
  };
  rows.forEach((row, k) => {
    const id = k === 0 ? "" : String(k + 1);
    const top = 1 - (k * ROW_PX) / inner, bottom = 1 - ((k + 1) * ROW_PX - GAP_PX) / inner;
    layout[`yaxis${id}`] = { domain: [Math.max(0, bottom), top], title: { text: row.title, standoff: 6 }, gridcolor: "#edf1f4", zeroline: false, automargin: false, fixedrange: true };
    for (const trace of row.traces) {
      traces.push({ type: "scatter", mode: "lines", x: t, yaxis: `y${id}`, xaxis: "x", connectgaps: false, hovertemplate: `${trace.name ?? ""} %{y:.4~f}<extra></extra>`, ...trace });
    }
    if (row.axes) {
      row.traces.forEach((trace, n) => annotations.push({
        xref: "paper", yref: "paper", x: 1, y: top, xanchor: "right", yanchor: "bottom", xshift: -LEGEND_PX * (row.traces.length - 1 - n), yshift: 0, showarrow: false,
        text: { x: "━━ x", y: "╍╍ y", z: "┈┈ z" }[trace.name], font: { color: AXES[trace.name], size: 13 },
      }));
    }
  });
  layout.annotations = annotations;
  Plotly.newPlot(box, traces, layout, { displayModeBar: false, responsive: true, doubleClick: "reset" }).then(() => link(t, columns, rows, [t0, t1]));
}

function link(t, columns, rows, window_s) {
  cursor.max = String(t.length - 1);
  const links = document.querySelectorAll("a[data-viewer]");
  const bases = [...links].map((link) => link.getAttribute("href"));
  const show = (k) => {
    const at = t[k];
    cursor.value = String(k);
    cursor.setAttribute("aria-valuetext", `${at.toFixed(3)} s`);
    Plotly.relayout(box, { "shapes[1].x0": at, "shapes[1].x1": at });
    links.forEach((link, n) => link.setAttribute("href", `${bases[n]}&t=${at.toFixed(3)}`));
    readout.replaceChildren(part("t", at, "s", 3), ...["x", "y", "z"].flatMap((axis) => comPart(columns, axis, k)), ...forcePart(columns, k));
  };
  cursor.addEventListener("input", () => show(Number(cursor.value)));
  box.on("plotly_click", (event) => show(event.points[0].pointIndex ?? event.points[0].pointNumber));
  const zoom = (range) => Plotly.relayout(box, { "xaxis.range": range });
  document.querySelector("[data-window]").addEventListener("click", () => zoom(window_s));
  document.querySelector("[data-all]").addEventListener("click", () => zoom([t[0], t[t.length - 1]]));
  const start = t.findIndex((value) => value >= (window_s[0] + window_s[1]) / 2);
  show(start < 0 ? 0 : start);
  box.dataset.ready = "true";
}

function part(name, value, unit, digits) {
  const span = document.createElement("span");
  const bold = document.createElement("b");
  bold.textContent = value === null || value === undefined ? "–" : `${value.toFixed(digits)} ${unit}`;
  span.append(`${name} `, bold);
  return span;
}

function comPart(columns, axis, k) {
  if (!columns[`${axis}_m`]) return [];
  const parts = [part(axis, columns[`${axis}_m`][k], "m", 4)];
  const sd = columns[`sd_${axis}_m`]?.[k];
  if (sd !== null && sd !== undefined) parts[0].append(` ± ${(1960 * sd).toFixed(1)} mm`);
  return parts;
}

function forcePart(columns, k) {
  return columns.force_z_n ? [part("vertical force", columns.force_z_n[k], "N", 0)] : [];
}
