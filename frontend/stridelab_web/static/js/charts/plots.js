// A figure of stacked curves with one time axis, so that zoom and cursor are shared.
import { fetchChecked } from "../shared/api.js";
import { colour, onColourScheme } from "../shared/colours.js";
import { createElement } from "../shared/elements.js";
import { translate } from "../shared/translate.js";

// Line styles by name; colours are those of the style sheet.
/** @type {Record<string, { color: string, width: number, dash?: string }>} */
const STYLES = {
  main: { color: "blue", width: 2 },
  second: { color: "orange-mid", width: 1.4, dash: "dash" },
  third: { color: "slate", width: 1.4, dash: "dot" },
  x: { color: "blue", width: 1.6 },
  y: { color: "orange-mid", width: 1.6, dash: "dash" },
  z: { color: "slate", width: 1.6, dash: "dot" },
  left: { color: "blue", width: 1.6 },
  right: { color: "orange-mid", width: 1.6, dash: "dash" },
  hand: { color: "slate", width: 1.6, dash: "dot" },
  line1: { color: "blue", width: 2 },
  line2: { color: "orange-mid", width: 1.6 },
  line3: { color: "orange-mid", width: 1.6, dash: "dash" },
  line4: { color: "green", width: 1.6 },
  line5: { color: "green", width: 1.6, dash: "dash" },
  line6: { color: "purple", width: 1.6, dash: "dashdot" },
  line7: { color: "slate", width: 1.6, dash: "dot" },
  line8: { color: "ink", width: 1.2, dash: "longdash" },
  full1: { color: "blue", width: 1.8 },
  full2: { color: "orange-mid", width: 1.8 },
  full3: { color: "slate", width: 1.8 },
  full4: { color: "purple", width: 1.8 },
  dashed1: { color: "blue", width: 1.8, dash: "dash" },
  dashed2: { color: "orange-mid", width: 1.8, dash: "dash" },
  dashed3: { color: "slate", width: 1.8, dash: "dash" },
  dashed4: { color: "purple", width: 1.8, dash: "dash" },
};
const lineStyle = (/** @type {string} */ style) => ({ ...STYLES[style], color: colour(STYLES[style].color) });
/** @type {Record<string, string>} */
const DASH_SAMPLES = { solid: "━━", dash: "╍╍", dot: "┈┈" };
const LOG_TICKS = [-2, -1, 0, 1, 2].flatMap((power) => [1, 2, 5].map((digit) => digit * 10 ** power));
// The figure scales with the font size. Strips of intervals (`.strip.timed`) have the same left and right margins, so that
// their time axes agree.
const FONT_SCALE = parseFloat(getComputedStyle(document.documentElement).fontSize) / 16;
const [ROW_PX, GAP_PX, TOP_PX, BOTTOM_PX, LETTER_PX, SAMPLE_PX, LEFT_PX, RIGHT_PX] = [
  170, 26, 10, 46, 8, 44, 74, 16,
].map((px) => px * FONT_SCALE);

const box = document.getElementById("plots");
const cursor = document.getElementById("cursor");
const readout = document.getElementById("readout");
const unreadable = translate("The curves could not be read. Reload the page to try again.");
try {
  draw(await (await fetchChecked(box.dataset.plots, {}, unreadable)).json());
} catch (error) {
  showReason(/** @type {Error} */ (error).message);
}

// Says why there are no curves, in place of them and of what moves them.
/** @param {string} text */
function showReason(text) {
  const note = createElement("p", { className: "note warn", role: "status" }, text);
  box.closest("section").querySelector(".plots-bar").remove();
  box.parentElement.replaceWith(note);
}

/** @param {PlotRow} row @param {PlotColumns} columns @returns {any[]} */
function rowTraces(row, columns) {
  return row.traces.flatMap((trace) => {
    const y = columns[trace.key],
      sd = trace.sd && columns[trace.sd];
    const curve = { name: trace.name, y, line: lineStyle(trace.style), key: trace.key, group: trace.group };
    if (!sd) return [curve];
    const bound = (/** @type {number} */ sign) =>
      y.map((v, k) => (v === null || sd[k] === null ? null : v + sign * 1.96 * sd[k]));
    const line = { width: 0, color: colour("blue") };
    return [
      { y: bound(-1), line, hoverinfo: "skip" },
      { y: bound(1), line, fill: "tonexty", fillcolor: colour("band-fill"), hoverinfo: "skip" },
      curve,
    ];
  });
}

/** @param {PlotDocument} data */
function draw(data) {
  const { traces, layout } = buildFigure(data);
  box.style.height = `${layout.height}px`; // a figure that is resized takes the height of its element
  Plotly.newPlot(box, traces, layout, { displayModeBar: false, responsive: true, doubleClick: "reset" }).then(() =>
    linkCursor(abscissa(data), data),
  );
  onColourScheme(() => recolour(data));
}

// Redraws the figure in the current colours, with its zoom, switches and cursor.
/** @param {PlotDocument} data */
function recolour(data) {
  const { traces, layout } = buildFigure(data),
    shown = box.layout;
  for (const [k, trace] of traces.entries()) trace.visible = box.data[k].visible;
  Object.assign(layout.xaxis, { range: shown.xaxis.range, autorange: shown.xaxis.autorange });
  const { x0, x1 } = shown.shapes.at(-1);
  Object.assign(layout.shapes.at(-1), { x0, x1 });
  Plotly.react(box, traces, layout);
}

// The values of the horizontal axis, which are complete.
/** @param {PlotDocument} data */
function abscissa({ columns, x }) {
  return /** @type {number[]} */ (columns[x.key]);
}

/** @param {PlotDocument} data */
function buildFigure(data) {
  const { columns, rows, shades_s, x } = data;
  const t = abscissa(data);
  const height = TOP_PX + BOTTOM_PX + rows.length * ROW_PX;
  const inner = height - TOP_PX - BOTTOM_PX;
  /** @type {any[]} */
  const traces = [];
  /** @type {object[]} */
  const annotations = [];
  /** @type {Record<string, any>} */
  const layout = {
    height,
    margin: { l: LEFT_PX, r: RIGHT_PX, t: TOP_PX, b: BOTTOM_PX },
    showlegend: false,
    hovermode: "x",
    hoversubplots: "axis",
    dragmode: "zoom",
    paper_bgcolor: colour("card"),
    plot_bgcolor: colour("card"),
    font: { family: "system-ui, DejaVu Sans, sans-serif", size: 12 * FONT_SCALE, color: colour("ink") },
    xaxis: {
      title: { text: x.title },
      type: x.log ? "log" : "linear",
      range: axisRange(x, t[0], t[t.length - 1]),
      gridcolor: colour("grid"),
      zeroline: false,
      showspikes: true,
      spikemode: "across",
      spikethickness: 1,
      spikecolor: colour("grey"),
      spikedash: "solid",
      spikesnap: "cursor",
      anchor: "free",
      position: 0,
    },
    shapes: [
      ...shades_s.map(([x0, x1]) => ({
        type: "rect",
        xref: "x",
        yref: "paper",
        x0,
        x1,
        y0: 0,
        y1: 1,
        fillcolor: colour("shade-fill"),
        line: { width: 0 },
        layer: "below",
      })),
      {
        type: "line",
        xref: "x",
        yref: "paper",
        x0: t[0],
        x1: t[0],
        y0: 0,
        y1: 1,
        line: { color: colour("orange-mid"), width: 1.5 },
      },
    ],
  };
  if (x.log) Object.assign(layout.xaxis, { tickvals: LOG_TICKS, exponentformat: "none" });
  rows.forEach((row, k) => {
    const id = k === 0 ? "" : String(k + 1);
    const top = 1 - (k * ROW_PX) / inner,
      bottom = 1 - ((k + 1) * ROW_PX - GAP_PX) / inner;
    layout[`yaxis${id}`] = {
      domain: [Math.max(0, bottom), top],
      title: { text: row.title, standoff: 6 },
      type: row.log ? "log" : "linear",
      gridcolor: colour("grid"),
      zeroline: false,
      automargin: false,
      fixedrange: true,
      exponentformat: "e",
    };
    if (row.log) Object.assign(layout[`yaxis${id}`], { dtick: 2, exponentformat: "none" });
    for (const trace of rowTraces(row, columns)) {
      if (row.steps) trace.line = { ...trace.line, shape: "hv" };
      traces.push({
        type: "scatter",
        mode: "lines",
        x: t,
        yaxis: `y${id}`,
        xaxis: "x",
        connectgaps: false,
        hovertemplate: `${trace.name ?? ""} %{y:.4~f}<extra></extra>`,
        ...trace,
      });
    }
    if (row.legend) annotations.push(...legend(row, top));
  });
  layout.annotations = annotations;
  return { traces, layout };
}

// The range of an axis; plotly takes that of a logarithmic one as exponents.
/** @param {PlotAxis} x @param {number} from @param {number} to */
function axisRange(x, from, to) {
  return x.log ? [Math.log10(from), Math.log10(to)] : [from, to];
}

// Adds a checkbox per group of curves, with a sample of its line.
/** @param {PlotDocument["switches"]} switches @param {() => void} updateReadout */
function addSwitches(switches, updateReadout) {
  const place = document.querySelector("[data-switches]");
  for (const { key, name, style, shown } of switches) {
    const indices = box.data.flatMap((trace, k) => (trace.group === key ? [k] : []));
    const input = createElement("input", { type: "checkbox", checked: shown });
    input.dataset.group = key;
    input.addEventListener("change", () => {
      Plotly.restyle(box, { visible: input.checked }, indices);
      updateReadout();
    });
    if (!shown) Plotly.restyle(box, { visible: false }, indices);
    place.append(createElement("label", {}, input, " ", createElement("span", { className: `key ${style}` }), name));
  }
}

// Names of the curves above the right end of a row, each with a sample of its line.
/** @param {PlotRow} row @param {number} top */
function legend(row, top) {
  let right = 0;
  return row.traces
    .filter((trace) => trace.listed)
    .reverse()
    .map((trace) => {
      const { color, dash } = lineStyle(trace.style);
      const entry = {
        xref: "paper",
        yref: "paper",
        x: 1,
        y: top,
        xanchor: "right",
        yanchor: "bottom",
        xshift: -right,
        showarrow: false,
        text: `${DASH_SAMPLES[dash ?? "solid"]} ${trace.name}`,
        font: { color, size: 13 * FONT_SCALE },
      };
      right += SAMPLE_PX + LETTER_PX * trace.name.length;
      return entry;
    });
}

/**
 * @param {number[]} t
 * @param {{ columns: PlotColumns, readings: PlotReading[], shades_s: PlotDocument["shades_s"], switches: PlotDocument["switches"], x: PlotAxis }} options
 */
function linkCursor(t, { columns, readings, shades_s, switches, x }) {
  const line = `shapes[${shades_s.length}]`;
  cursor.max = String(t.length - 1);
  const links = document.querySelectorAll("a[data-viewer]");
  const bases = [...links].map((link) => link.getAttribute("href"));
  const updateReadout = () => {
    const k = Number(cursor.value);
    const hiddenGroups = new Set(
      [...document.querySelectorAll("[data-group]:not(:checked)")].map((input) => input.dataset.group),
    );
    const shown = readings.filter((reading) => !hiddenGroups.has(reading.group ?? ""));
    readout.replaceChildren(
      readingNode(x.name, [t[k]], x.unit, x.digits),
      ...shown.map((reading) => channelReading(reading, columns, k)),
    );
  };
  const show = (/** @type {number} */ k) => {
    const time = t[k];
    cursor.value = String(k);
    cursor.setAttribute("aria-valuetext", `${time.toFixed(x.digits)} ${x.unit}`);
    Plotly.relayout(box, { [`${line}.x0`]: time, [`${line}.x1`]: time });
    for (const [n, link] of links.entries()) link.setAttribute("href", `${bases[n]}&t=${time.toFixed(3)}`);
    updateReadout();
    document.dispatchEvent(new CustomEvent("instant", { detail: time }));
  };
  document.addEventListener("seek", ({ detail }) => {
    const next = t.findIndex((value) => value >= detail);
    show(next < 0 ? t.length - 1 : next);
  });
  cursor.addEventListener("input", () => show(Number(cursor.value)));
  box.on("plotly_click", (event) => show(event.points[0].pointIndex ?? event.points[0].pointNumber));
  const zoom = (/** @type {[number, number]} */ [from, to]) =>
    Plotly.relayout(box, { "xaxis.range": axisRange(x, from, to) });
  const toWindow = document.querySelector("[data-window]");
  if (toWindow && shades_s.length) toWindow.addEventListener("click", () => zoom(shades_s[0]));
  else toWindow?.remove();
  document.querySelector("[data-all]").addEventListener("click", () => zoom([t[0], t[t.length - 1]]));
  addSwitches(switches, updateReadout);
  if (!x.log) {
    const announceSpan = () =>
      document.dispatchEvent(new CustomEvent("span", { detail: [...box._fullLayout.xaxis.range] }));
    box.on("plotly_relayout", (change) => Object.keys(change).some((key) => key.startsWith("xaxis")) && announceSpan());
    announceSpan();
  }
  const [from, to] = shades_s[0] ?? [t[0], t[0]];
  const start = t.findIndex((value) => value >= (from + to) / 2);
  show(start < 0 ? 0 : start);
  box.dataset.ready = "true";
}

/** @param {string} name @param {(number | null | undefined)[]} values @param {string} unit @param {number} digits */
function readingNode(name, values, unit, digits) {
  const texts = values.map((value) => value?.toFixed(digits).replace(/^-(0\.?0*)$/, "$1") ?? "–");
  const shown = texts.every((text) => text === "–") ? "–" : `${texts.join(", ")} ${unit}`;
  return createElement("span", {}, `${name} `, createElement("b", {}, shown));
}

/**
 * @param {{ name: string, key: string, unit: string, digits: number, sd: string | null, more: string[] }} options
 * @param {PlotColumns} columns
 * @param {number} k
 */
function channelReading({ name, key, unit, digits, sd, more }, columns, k) {
  const shown = readingNode(
    name,
    [key, ...more].map((column) => columns[column]?.[k]),
    unit,
    digits,
  );
  const spread = sd ? columns[sd]?.[k] : null;
  if (spread !== null && spread !== undefined) shown.append(` ± ${(1960 * spread).toFixed(1)} mm`);
  return shown;
}
