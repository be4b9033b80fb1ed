// Figures 4.2 and 4.4: six maps of an effector's density on one scale, and the volumes of its level sets.
import { colour, onColourScheme } from "../shared/colours.js";

const LEFT_PX = 64,
  RIGHT_PX = 40,
  BAR_PX = 14,
  BAR_GAP_PX = 22,
  TOP_PX = 30,
  BOTTOM_PX = 46,
  GAP_PX = 62,
  ROW_GAP_PX = 64,
  MAX_HEIGHT_PX = 420,
  LITRES = 1000;
// One hue with increasing contrast to the page: readable with colour blindness and in print.
const colorScale = () => [0, 0.15, 0.4, 0.7, 1].map((share, k) => [share, colour(k ? `depth-${k}` : "card")]);

const box = document.getElementById("maps");
const choice = document.querySelector("[data-effector-of-maps]");
const status = document.querySelector("[data-maps-said]");
const extent = (/** @type {number[]} */ values) => values[values.length - 1] - values[0];
/** @type {any} */
let shown = null,
  requestCount = 0;

choice.addEventListener("change", () => showEffector(choice.value));
new ResizeObserver(() => shown && draw(shown)).observe(box);
onColourScheme(() => shown && draw(shown));
await showEffector(choice.value);
for (const option of choice.options)
  if (option.value !== shown?.effector) readDensity(option.value).then(writeVolumes, () => {});

/** @param {string} effector */
async function readDensity(effector) {
  const url = new URL(box.dataset.maps, location.href);
  url.searchParams.set("effector", effector);
  const response = await fetch(url, { headers: { Accept: "application/json" } });
  const density = await response.json().catch(() => null);
  if (!response.ok || !density) throw new Error(density?.detail || "The densities could not be read.");
  return density;
}

/** @param {string} effector */
async function showEffector(effector) {
  const request = ++requestCount;
  status.textContent = "Reading…";
  try {
    const density = await readDensity(effector);
    if (request !== requestCount) return;
    writeVolumes(density);
    draw(density);
    shown = density;
    status.textContent = "";
    box.dataset.ready = effector;
  } catch (error) {
    status.textContent = /** @type {Error} */ (error).message;
  }
}

/** @param {{ effector: string, volumes_m3: Record<string, number> }} options */
function writeVolumes({ effector, volumes_m3 }) {
  const row = document.querySelector(`tr[data-effector="${CSS.escape(effector)}"]`);
  for (const cell of row.querySelectorAll("[data-volume]"))
    cell.textContent = ((volumes_m3[cell.dataset.volume] ?? NaN) * LITRES).toFixed(0);
}

// The domains of the axes make a metre equally long in all maps.
/** @param {{ components: number, frame: string, maps: DensityMap[] }} options */
function draw({ components, frame, maps }) {
  const width = box.clientWidth;
  const across = maps.reduce((sum, map) => sum + extent(map.right_m), 0),
    highest = Math.max(...maps.map((map) => extent(map.up_m)));
  const px = Math.min(
    (width - LEFT_PX - RIGHT_PX - BAR_PX - BAR_GAP_PX - 2 * GAP_PX) / across,
    MAX_HEIGHT_PX / highest,
  );
  const height = TOP_PX + BOTTOM_PX + ROW_GAP_PX + 2 * px * highest;
  const inner = { width: width - LEFT_PX - RIGHT_PX, height: height - TOP_PX - BOTTOM_PX };
  const zmax = Math.max(
    ...maps.flatMap((map) => [map.kernel_per_m2, map.mixture_per_m2]).map((rows) => Math.max(...rows.flat())),
  );
  /** @type {object[]} */
  const traces = [];
  /** @type {object[]} */
  const annotations = [];
  const colorscale = colorScale();
  /** @type {Record<string, any>} */
  const layout = {
    width,
    height,
    margin: { l: LEFT_PX, r: RIGHT_PX, t: TOP_PX, b: BOTTOM_PX },
    showlegend: false,
    dragmode: false,
    paper_bgcolor: colour("card"),
    plot_bgcolor: colour("card"),
    font: { family: "system-ui, DejaVu Sans, sans-serif", size: 12, color: colour("ink") },
    annotations,
  };
  let left = 0;
  maps.forEach((map, column) => {
    const wide = px * extent(map.right_m),
      tall = px * extent(map.up_m);
    ["kernel_per_m2", "mixture_per_m2"].forEach((key, row) => {
      const k = 2 * column + row,
        id = k === 0 ? "" : String(k + 1);
      const top = inner.height - row * (px * highest + ROW_GAP_PX) - (px * highest - tall) / 2;
      const axis = {
        showgrid: false,
        zeroline: false,
        ticks: "outside",
        ticklen: 3,
        mirror: true,
        showline: true,
        linecolor: colour("rule"),
        linewidth: 1,
        dtick: 0.5,
        fixedrange: true,
      };
      layout[`xaxis${id}`] = {
        ...axis,
        domain: [left / inner.width, (left + wide) / inner.width],
        anchor: `y${id}`,
        range: [map.right_m[0], map.right_m.at(-1)],
        title: { text: `${map.right} [m]`, standoff: 4 },
      };
      layout[`yaxis${id}`] = {
        ...axis,
        domain: [(top - tall) / inner.height, top / inner.height],
        anchor: `x${id}`,
        range: [map.up_m[0], map.up_m.at(-1)],
        title: { text: `${map.up} [m]`, standoff: 4 },
      };
      traces.push({
        type: "heatmap",
        x: map.right_m,
        y: map.up_m,
        z: map[key],
        xaxis: `x${id}`,
        yaxis: `y${id}`,
        zmin: 0,
        zmax,
        colorscale,
        zsmooth: "best",
        showscale: false,
        hovertemplate: `${map.right} %{x:.2f} m, ${map.up} %{y:.2f} m<br>%{z:.3~g} per m²<extra></extra>`,
      });
      traces.push({
        type: "scatter",
        mode: "markers",
        x: [0],
        y: [0],
        xaxis: `x${id}`,
        yaxis: `y${id}`,
        marker: { symbol: "cross-thin-open", size: 11, color: colour("orange-mid"), line: { width: 2 } },
        hovertemplate: `origin of the ${frame} frame<extra></extra>`,
        cliponaxis: true,
      });
      const title = row === 0 ? `kernels, along ${map.along}` : `mixture of ${components}, along ${map.along}`;
      annotations.push({
        xref: "paper",
        yref: "paper",
        x: (left + wide / 2) / inner.width,
        y: top / inner.height,
        text: title,
        showarrow: false,
        yanchor: "bottom",
        xanchor: "center",
        font: { size: 13 },
      });
    });
    left += wide + GAP_PX;
  });
  // A heatmap serves as the colour bar: plotly's own writes a style attribute, which the content policy refuses.
  const steps = Array.from({ length: 101 }, (_, k) => (k * zmax) / 100);
  layout.xaxis7 = { domain: [1 - BAR_PX / inner.width, 1], anchor: "y7", visible: false, fixedrange: true };
  layout.yaxis7 = {
    domain: [0.1, 0.9],
    anchor: "x7",
    side: "right",
    range: [0, zmax],
    ticks: "outside",
    ticklen: 3,
    zeroline: false,
    showgrid: false,
    fixedrange: true,
  };
  traces.push({
    type: "heatmap",
    x: [0],
    y: steps,
    z: steps.map((value) => [value]),
    xaxis: "x7",
    yaxis: "y7",
    zmin: 0,
    zmax,
    colorscale,
    showscale: false,
    hoverinfo: "skip",
    zsmooth: "fast",
  });
  annotations.push({
    xref: "paper",
    yref: "paper",
    x: 1,
    y: 0.9,
    yshift: 4,
    text: "1/m²",
    showarrow: false,
    yanchor: "bottom",
    xanchor: "right",
  });
  Plotly.react(box, traces, layout, { displayModeBar: false });
}
