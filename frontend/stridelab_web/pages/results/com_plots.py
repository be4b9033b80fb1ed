"""The curves of an estimate: the centre of mass with its band, and the three inputs that it was fused from."""

from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from stridelab_web.charts.plotly import Reading, Row, Switch, Trace, plot_document, xyz_row
from stridelab_web.parquet import Columns

COM_TABLE: Final = "com.parquet"
GRAVITY_M_S2: Final = {"x": 0.0, "y": 0.0, "z": -9.81}

SWITCHES = (
    Switch("geometry", "(i) markers only", "second"),
    Switch("force", "(ii) measured force", "second"),
    Switch("axis", "(iii) nearest point of the central axis", "third"),
)
"""The inputs of section 2.4.1, each on the rows in which it can be compared with the result."""

DECIMALS = {
    f"{before}{axis}_{unit}": digits
    for before, unit, digits in (
        ("", "m", 5), ("sd_", "m", 6), ("geometry_", "m", 5), ("axis_", "m", 5),
        ("v", "m_s", 4), ("force_", "n", 1), ("fused_force_", "n", 1),
    )
    for axis in "xyz"
}  # fmt: skip
"""Columns that are drawn, with the decimals that a plot can show: 0.01 mm, 0.1 mm/s, 0.1 N."""


def _com_row(axis: str) -> Row:
    inputs = (
        Trace(f"axis_{axis}_m", "nearest point of the axis", "third", group="axis"),
        Trace(f"geometry_{axis}_m", "markers only", "second", group="geometry"),
    )
    return Row(f"CoM {axis} [m]", (*inputs, Trace(f"{axis}_m", "fused", "main", f"sd_{axis}_m")))


def _force_row(axis: str) -> Row:
    measured = Trace(f"force_{axis}_n", "measured", "second", group="force")
    return Row(f"Force {axis} [N]", (Trace(f"fused_force_{axis}_n", "of the fused motion", "main"), measured))


ROWS = (
    *(_com_row(axis) for axis in "xyz"),
    xyz_row("Velocity [m/s]", ("vx_m_s", "vy_m_s", "vz_m_s")),
    *(_force_row(axis) for axis in "xyz"),
)
READINGS = (
    *(Reading(axis, f"{axis}_m", "m", 4, f"sd_{axis}_m") for axis in "xyz"),
    Reading("vertical force", "force_z_n", "N", 0),
)


def com_curves(columns: Columns, summary: Mapping[str, Any]) -> dict[str, Any]:
    """Plot document of a ``com`` table and the summary of its job; the window is shaded."""
    fused = {
        f"fused_force_{axis}_n": np.asarray(summary["mass_kg"] * (columns[f"a{axis}_m_s2"] - GRAVITY_M_S2[axis]))
        for axis in "xyz"
        if f"a{axis}_m_s2" in columns and summary["mass_kg"] is not None
    }
    return plot_document({**columns, **fused}, DECIMALS, ROWS, READINGS, [summary["window_s"]], SWITCHES)
