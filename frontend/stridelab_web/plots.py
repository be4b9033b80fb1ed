"""The curves of a result as compact JSON for the page's plots."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from stridelab_web.tables import Columns

SAMPLES_AT_MOST = 6000
"""A plot is some 1000 pixels wide; longer recordings are thinned for it (the files keep every sample)."""

DECIMALS = {
    "x_m": 5, "y_m": 5, "z_m": 5,
    "sd_x_m": 6, "sd_y_m": 6, "sd_z_m": 6,
    "geometry_x_m": 5, "geometry_y_m": 5, "geometry_z_m": 5,
    "vx_m_s": 4, "vy_m_s": 4, "vz_m_s": 4,
    "force_x_n": 1, "force_y_n": 1, "force_z_n": 1,
}  # fmt: skip
"""Columns that are drawn, with the decimals that a plot can show: 0.01 mm, 0.1 mm/s, 0.1 N."""


def curves(columns: Columns, window_s: Sequence[float]) -> dict[str, Any]:
    """What the plots need of a ``com`` table: ``window_s`` and a list per drawn column (null: no value)."""
    time_s = columns["time_s"]
    stride = max(1, -(-len(time_s) // SAMPLES_AT_MOST))
    drawn = {"time_s": _numbers(time_s[::stride], 5)}
    for name, digits in DECIMALS.items():
        if name in columns and np.isfinite(columns[name]).any():
            drawn[name] = _numbers(columns[name][::stride], digits)
    return {"window_s": list(window_s), "columns": drawn}


def _numbers(values: np.ndarray, digits: int) -> list[float | None]:
    rounded = np.round(values, digits)
    return [float(v) if np.isfinite(v) else None for v in rounded]
