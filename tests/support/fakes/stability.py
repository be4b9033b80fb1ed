"""A table ``stability`` whose feet, margins and angular momentum are known."""

import numpy as np

from stridelab_web.parquet import Columns, read_columns

CORNERS_M = np.array([[0.0, 0.0], [0.1, 0.0], [0.1, 0.1], [0.0, 0.1], [0.05, 0.05]])
"""A square foot; the fifth point is inside."""


def stability_table(tracks: bytes) -> Columns:
    """The left foot stands beside the line, the right one 0.2 m to its right from frame 100 on.

    The extrapolated CoM is 0.05 m inside the left edge, outside it by 0.02 m from frame 50 to 99.
    """
    time_s = read_columns(tracks)["time_s"]
    n, frame = len(time_s), np.arange(len(time_s))
    y_m = np.where((frame >= 50) & (frame < 100), 0.12, 0.05)
    columns = {"time_s": time_s, "x_m": np.zeros(n), "y_m": np.zeros(n), "z_m": np.ones(n)}
    columns |= {"xcom_x_m": np.zeros(n), "xcom_y_m": y_m, "xcom_z_m": np.zeros(n)}
    columns |= {"momentum_x_m2_s": np.full(n, 0.1), "momentum_y_m2_s": np.zeros(n), "momentum_z_m2_s": np.zeros(n)}
    for side, shift_m, stands in (("left", 0.0, np.ones(n, bool)), ("right", -0.2, frame >= 100)):
        edge_m = 0.1 if side == "left" else shift_m
        margin_m = (edge_m - y_m) * (1.0 if side == "left" else -1.0)
        columns[f"{side}_margin_m"] = np.where(stands, margin_m, np.nan)
        for axis, value in zip("xyz", (0.0, edge_m, 0.0), strict=True):
            columns[f"{side}_edge_{axis}_m"] = np.where(stands, value, np.nan)
        for k, (x, y) in enumerate(CORNERS_M):
            for axis, value in zip("xyz", (x, y + shift_m, 0.0), strict=True):
                columns[f"{side}_outline{k}_{axis}_m"] = np.where(stands, value, np.nan)
    return columns
