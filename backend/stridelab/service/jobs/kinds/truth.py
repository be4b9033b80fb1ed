"""The exact motion of a simulated recording as a table, and an estimate compared with it."""

from pathlib import Path

import numpy as np
import pyarrow.parquet as pq

from stridelab.conventions import Mask, Points, Series
from stridelab.experiments.simulated_recording import Truth


def truth_columns(truth: Truth) -> dict[str, Series | Mask]:
    """Columns ``com_x_m..``, ``l_x_nms..`` (about the CoM), ``fx_n..``, ``mx_nm..`` (at the world origin)."""
    columns: dict[str, Series | Mask] = {"time_s": truth.time_s}
    for name, track in (
        ("com_{}_m", truth.com_m),
        ("l_{}_nms", truth.l_nms),
        ("f{}_n", truth.force_n),
        ("m{}_nm", truth.moment_nm),
    ):
        columns |= {name.format(axis): track[:, i] for i, axis in enumerate("xyz")}
    return columns


def com_errors_mm(com: Path, truth: Path) -> dict[str, tuple[float, float, float]]:
    """RMS error per axis in millimetres of the fused CoM and of the geometry, over the frames that both give."""
    true_m = _points(truth, "com_{}_m")
    tracks = {"fused": _points(com, "{}_m"), "markers only": _points(com, "geometry_{}_m")}
    common = np.logical_and.reduce([np.isfinite(track).all(axis=1) for track in tracks.values()])
    errors: dict[str, tuple[float, float, float]] = {}
    for name, track in tracks.items():
        x, y, z = (float(e) for e in 1e3 * np.sqrt(np.mean((track - true_m)[common] ** 2, axis=0)))
        errors[name] = (x, y, z)
    return errors


def _points(table: Path, name: str) -> Points:
    columns = [name.format(axis) for axis in "xyz"]
    read = pq.read_table(table, columns=columns)
    return np.column_stack([read[column].to_numpy() for column in columns])
