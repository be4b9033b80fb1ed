"""The curves of a result as compact JSON for the page's plots: columns, and how they are drawn in rows."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Literal

import numpy as np

from stridelab_web.tables import Columns

SAMPLES_AT_MOST = 6000
"""A plot is some 1000 pixels wide; longer recordings are thinned for it (the files keep every sample)."""

Style = Literal["main", "second", "x", "y", "z", "left", "right", "hand"]


@dataclass(frozen=True)
class Trace:
    """One curve: its column, and ``sd``, the column of its standard deviation where it has a band."""

    key: str
    name: str
    style: Style
    sd: str | None = None


@dataclass(frozen=True)
class Row:
    """Curves above each other on one vertical axis; ``legend`` names them beside the row."""

    title: str
    traces: tuple[Trace, ...]
    legend: bool = False


@dataclass(frozen=True)
class Reading:
    """A number that the readout shows at the cursor."""

    name: str
    key: str
    unit: str
    digits: int
    sd: str | None = None


DECIMALS = {
    "x_m": 5, "y_m": 5, "z_m": 5,
    "sd_x_m": 6, "sd_y_m": 6, "sd_z_m": 6,
    "geometry_x_m": 5, "geometry_y_m": 5, "geometry_z_m": 5,
    "vx_m_s": 4, "vy_m_s": 4, "vz_m_s": 4,
    "force_x_n": 1, "force_y_n": 1, "force_z_n": 1,
}  # fmt: skip
"""Columns that are drawn, with the decimals that a plot can show: 0.01 mm, 0.1 mm/s, 0.1 N."""


def three(title: str, keys: Sequence[str]) -> Row:
    """A row with the x, y and z components of something."""
    x, y, z = keys
    return Row(title, (Trace(x, "x", "x"), Trace(y, "y", "y"), Trace(z, "z", "z")), legend=True)


def _com_row(axis: str) -> Row:
    geometry = Trace(f"geometry_{axis}_m", "markers only", "second")
    return Row(f"CoM {axis} [m]", (geometry, Trace(f"{axis}_m", "fused", "main", f"sd_{axis}_m")))


COM_ROWS = (
    *(_com_row(axis) for axis in "xyz"),
    three("Velocity [m/s]", ("vx_m_s", "vy_m_s", "vz_m_s")),
    three("Ground reaction force [N]", ("force_x_n", "force_y_n", "force_z_n")),
)
COM_READINGS = (
    *(Reading(a, f"{a}_m", "m", 4, f"sd_{a}_m") for a in "xyz"),
    Reading("vertical force", "force_z_n", "N", 0),
)


def curves(columns: Columns, window_s: Sequence[float]) -> dict[str, Any]:
    """What the plots need of a ``com`` table; ``window_s`` is shaded."""
    return drawing(columns, DECIMALS, COM_ROWS, COM_READINGS, [window_s])


def drawing(
    columns: Columns,
    decimals: Mapping[str, int],
    rows: Sequence[Row],
    readings: Sequence[Reading],
    shades_s: Sequence[Sequence[float]],
) -> dict[str, Any]:
    """A list per drawn column (null: no value), thinned to what a plot can show, and the rows that draw them.

    Columns without a finite value go, and with them their traces, readings and empty rows.
    """
    time_s = columns["time_s"]
    stride = max(1, -(-len(time_s) // SAMPLES_AT_MOST))
    drawn = {"time_s": _numbers(time_s[::stride], 5)}
    for name, digits in decimals.items():
        if name in columns and np.isfinite(columns[name]).any():
            drawn[name] = _numbers(columns[name][::stride], digits)
    kept = [(row, [trace for trace in row.traces if trace.key in drawn]) for row in rows]
    return {
        "shades_s": [list(shade) for shade in shades_s],
        "columns": drawn,
        "rows": [
            {"title": row.title, "legend": row.legend, "traces": [asdict(trace) for trace in traces]}
            for row, traces in kept
            if traces
        ],
        "readings": [asdict(reading) for reading in readings if reading.key in drawn],
    }


def _numbers(values: np.ndarray, digits: int) -> list[float | None]:
    rounded = np.round(values, digits)
    return [float(v) if np.isfinite(v) else None for v in rounded]
