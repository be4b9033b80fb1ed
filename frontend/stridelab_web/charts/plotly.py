"""Curves as compact JSON for a page's plots: columns, and how they are drawn in rows above one shared axis."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Literal

import numpy as np

from stridelab.translations.catalogue import gettext
from stridelab_web.parquet import Columns

MAX_SAMPLES = 6000
"""Maximum samples per curve; plots are about 1000 pixels wide, and the files contain every sample."""

Style = Literal[
    "main", "second", "third", "x", "y", "z", "left", "right", "hand",
    "line1", "line2", "line3", "line4", "line5", "line6", "line7", "line8",
    "full1", "full2", "full3", "full4", "dashed1", "dashed2", "dashed3", "dashed4",
]  # fmt: skip
"""How a curve is drawn (static/js/charts/plots.js); the numbered ones tell up to eight curves apart by colour and dash,
or four, each full and dashed."""


@dataclass(frozen=True)
class Trace:
    """One curve: its column, ``sd``, the column of its standard deviation where it has a band, and its switch.

    A curve that is not ``listed`` has no name in its row's legend.
    """

    key: str
    name: str
    style: Style
    sd: str | None = None
    group: str | None = None
    listed: bool = True


@dataclass(frozen=True)
class Row:
    """Curves above each other on one vertical axis; ``legend`` names them beside the row; ``log``: by decades.

    With ``steps`` a value holds until the next one.
    """

    title: str
    traces: tuple[Trace, ...]
    legend: bool = False
    log: bool = False
    steps: bool = False


@dataclass(frozen=True)
class Reading:
    """A value of the readout at the cursor, followed by those of the columns ``more``.

    A reading with a ``group`` is shown while the group is.
    """

    name: str
    key: str
    unit: str
    digits: int
    sd: str | None = None
    more: tuple[str, ...] = ()
    group: str | None = None


@dataclass(frozen=True)
class Switch:
    """Shows or hides all traces of the group ``key``."""

    key: str
    name: str
    style: Style
    shown: bool = True


@dataclass(frozen=True)
class Abscissa:
    """The axis that all rows share: its column, its title, and how the readout writes a value."""

    key: str
    title: str
    name: str
    unit: str
    digits: int
    log: bool = False


TIME = Abscissa("time_s", "time [s]", "t", "s", 3)


def xyz_row(title: str, keys: Sequence[str]) -> Row:
    """A row with the x, y and z components of a vector."""
    x, y, z = keys
    return Row(title, (Trace(x, "x", "x"), Trace(y, "y", "y"), Trace(z, "z", "z")), legend=True)


def plot_document(
    columns: Columns,
    decimals: Mapping[str, int],
    rows: Sequence[Row],
    readings: Sequence[Reading],
    shades_s: Sequence[Sequence[float]],
    switches: Sequence[Switch] = (),
    x: Abscissa = TIME,
) -> dict[str, Any]:
    """JSON document of a plot: a thinned list per drawn column (null: no value), and the rows that draw them.

    Columns without a finite value are left out with their traces, readings, switches and empty rows. ``shades_s`` are
    intervals of the axis ``x``. Titles and names are translated where the catalogue has them.
    """
    along = columns[x.key]
    stride = max(1, -(-len(along) // MAX_SAMPLES))
    drawn = {x.key: _rounded_values(along[::stride], 5)}
    for name, digits in decimals.items():
        if name in columns and np.isfinite(columns[name]).any():
            drawn[name] = _rounded_values(columns[name][::stride], digits)
    drawn_rows = [(row, [trace for trace in row.traces if trace.key in drawn]) for row in rows]
    groups = {trace.group for _, traces in drawn_rows for trace in traces}
    return {
        "x": _translated(asdict(x), "title"),
        "switches": [_translated(asdict(switch), "name") for switch in switches if switch.key in groups],
        "shades_s": [list(shade) for shade in shades_s],
        "columns": drawn,
        "rows": [
            {**_translated(asdict(row), "title"), "traces": [_translated(asdict(trace), "name") for trace in traces]}
            for row, traces in drawn_rows
            if traces
        ],
        "readings": [_translated(asdict(reading), "name") for reading in readings if reading.key in drawn],
    }


def _translated(item: dict[str, Any], key: str) -> dict[str, Any]:
    return {**item, key: gettext(item[key])} if item[key] else item


def _rounded_values(values: np.ndarray, digits: int) -> list[float | None]:
    rounded = np.round(values, digits)
    return [float(v) if np.isfinite(v) else None for v in rounded]
