"""The curves of a comparison: error spectra, deviations over time, contributions of the inputs, and the filters."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from stridelab.schemas.comparison import CompareEstimatorsSummary
from stridelab_web.charts.plotly import TIME, Abscissa, Reading, Row, Style, Switch, Trace, plot_document
from stridelab_web.formatting import method_name
from stridelab_web.parquet import Columns

STYLES: Final[Mapping[str, Style]] = {
    "smoother": "line1", "complementary": "line2", "complementary-thesis": "line3", "rts": "line6",
    "kalman": "line4", "kalman-thesis": "line5", "geometry": "line7",
}  # fmt: skip
"""Methods in the order of the pages, and how they are drawn."""
OTHER: Final[Style] = "line8"
INPUTS: Final[Mapping[str, tuple[str, Style]]] = {
    "geometry": ("(i) geometry", "line7"),
    "force": ("(ii) force", "line2"),
    "axis": ("(iii) central axis", "line1"),
}
"""The inputs of section 2.4.1 and how their shares are drawn."""
FREQUENCY = Abscissa("frequency_hz", "frequency [Hz]", "f", "Hz", 2, log=True)
DIGITS = 6
MIN_AMPLITUDE_M = 1e-8
"""Minimum amplitude per root hertz that is drawn."""
READINGS: Final = "The cursor reads x, y, z in the world frame."


@dataclass(frozen=True)
class Figure:
    """One view of the comparison: its table, title, description and hint, and the function that draws it."""

    table: str
    title: str
    description: str
    hint: str
    draw: Callable[[Columns, CompareEstimatorsSummary], dict[str, Any]]


def plot_spectra(columns: Columns, summary: CompareEstimatorsSummary) -> dict[str, Any]:
    """Amplitude densities (figure 2.6), on logarithmic axes, without the constant component."""
    positive = columns["frequency_hz"] > 0
    shown = {name: _without_rounding(values[positive]) for name, values in columns.items() if name.endswith("_m_rthz")}
    shown = {name: values if name == "frequency_hz" else 1000 * values for name, values in shown.items()}
    shown["frequency_hz"] = columns["frequency_hz"][positive]
    rows = [Row(f"{axis} [mm/√Hz]", _method_traces(summary, axis, "_m_rthz"), log=True) for axis in "xyz"]
    return _figure_document(
        shown, rows, _method_switches(summary), _method_readings(summary, "_m_rthz", "mm/√Hz"), FREQUENCY
    )


def plot_deviations(columns: Columns, summary: CompareEstimatorsSummary) -> dict[str, Any]:
    """Every estimate minus the truth, without a truth minus the geometry, over the window."""
    reference = "truth" if summary.reference == "truth" else "geometry"
    shown = {"time_s": columns["time_s"]}
    for name in summary.methods:
        for axis in "xyz":
            key, against = f"{_column_name(name)}_{axis}_m", f"{reference}_{axis}_m"
            if key in columns and against in columns and key != against:
                shown[key] = 1000 * (columns[key] - columns[against])
    rows = [Row(f"{axis} [mm]", _method_traces(summary, axis, "_m")) for axis in "xyz"]
    return _figure_document(shown, rows, _method_switches(summary), _method_readings(summary, "_m", "mm"), TIME)


def plot_contributions(columns: Columns, _: CompareEstimatorsSummary) -> dict[str, Any]:
    """Contribution of each input to the complementary filter (figure 2.7)."""
    rows = []
    for axis in "xyz":
        parts = [Trace(f"{key}_{axis}_m", name, style, group=key) for key, (name, style) in INPUTS.items()]
        rows.append(Row(f"{axis} [m]", (Trace(f"total_{axis}_m", "sum", "line4", group="total"), *parts)))
    readings = [
        Reading(name, f"{key}_x_m", "m", 3, more=(f"{key}_y_m", f"{key}_z_m"), group=key)
        for key, name in (("total", "sum"), *((key, name) for key, (name, _style) in INPUTS.items()))
    ]
    switches = [Switch("total", "sum", "line4"), *(Switch(k, name, style) for k, (name, style) in INPUTS.items())]
    return _figure_document(columns, rows, switches, readings, TIME)


def plot_filters(columns: Columns, _: CompareEstimatorsSummary) -> dict[str, Any]:
    """Gain and phase of the complementary filters (figure 2.5)."""
    lowest = -100.0
    shown = {name: np.maximum(v, lowest) if name.endswith("_db") else v for name, v in columns.items()}
    rows = [
        Row(title, tuple(Trace(f"{key}_{suffix}", name, style, group=key) for key, (name, style) in INPUTS.items()))
        for title, suffix in (("Gain [dB]", "gain_db"), ("Phase [rad]", "phase_rad"))
    ]
    readings = [Reading(name, f"{key}_gain_db", "dB", 1, group=key) for key, (name, _style) in INPUTS.items()]
    return _figure_document(
        shown, rows, [Switch(k, name, style) for k, (name, style) in INPUTS.items()], readings, FREQUENCY
    )


FIGURES: Final[Mapping[str, Figure]] = {
    "spectra": Figure(
        "spectra.parquet",
        "Error spectra",
        "Amplitude of every method's error by frequency.",
        "Amplitude per root hertz of each method's error; where the truth is not known, of its difference from the "
        f"markers. {READINGS}",
        plot_spectra,
    ),
    "time": Figure(
        "comparison.parquet",
        "Over time",
        "Every method's deviation over time.",
        f"Each method's error; where the truth is not known, its difference from the markers. {READINGS}",
        plot_deviations,
    ),
    "contributions": Figure(
        "contributions.parquet",
        "Contributions",
        "Contribution of each input to the complementary filter over time.",
        f"Contribution of each input to the complementary filter; their sum is its result. {READINGS}",
        plot_contributions,
    ),
    "filters": Figure(
        "bode.parquet",
        "Filters",
        "Gain and phase of the complementary filters by frequency.",
        "How the complementary filter shares the frequencies between its inputs. The cursor reads the gain.",
        plot_filters,
    ),
}
"""The views; the first one is the default."""


def _method_traces(summary: CompareEstimatorsSummary, axis: str, after: str) -> tuple[Trace, ...]:
    return tuple(
        Trace(f"{_column_name(name)}_{axis}{after}", method_name(name), STYLES.get(name, OTHER), group=name)
        for name in summary.methods
    )


def _method_switches(summary: CompareEstimatorsSummary) -> list[Switch]:
    return [Switch(name, method_name(name), STYLES.get(name, OTHER)) for name in summary.methods]


def _method_readings(summary: CompareEstimatorsSummary, after: str, unit: str) -> list[Reading]:
    return [
        Reading(
            method_name(name), f"{_column_name(name)}_x{after}", unit, 2,
            more=(f"{_column_name(name)}_y{after}", f"{_column_name(name)}_z{after}"), group=name,
        )
        for name in summary.methods
    ]  # fmt: skip


def _figure_document(
    columns: Columns, rows: Sequence[Row], switches: Sequence[Switch], readings: Sequence[Reading], x: Abscissa
) -> dict[str, Any]:
    decimals = {trace.key: DIGITS for row in rows for trace in row.traces}
    return plot_document(columns, decimals, rows, readings, [], switches, x)


def _without_rounding(values: np.ndarray) -> np.ndarray:
    """Replace rounding noise, which would set the scale, by NaN."""
    return np.where(values > MIN_AMPLITUDE_M, values, np.nan)


def _column_name(name: str) -> str:
    return name.replace("-", "_")
