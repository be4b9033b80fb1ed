"""The exact motion of a simulated recording as a table, and errors of an estimate with respect to it."""

from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
from jaxtyping import Float

from stridelab.conventions import Mask, Points, Series
from stridelab.errors import InvalidInput, UnreadableFile
from stridelab.estimation.evaluation.comparison import KnownMotion
from stridelab.simulation.human_recording import Truth

TruthPoints = Float[np.ndarray, "rows 3"]


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


def known_motion(truth: Path, time_s: Series) -> KnownMotion:
    """The true CoM and force of a ``truth.parquet`` at the instants ``time_s``.

    Raises ``UnreadableFile`` (``truth-unreadable``) for another file and ``InvalidInput`` (``truth-mismatch``) if the
    table does not cover the instants, so that it cannot belong to the recording.
    """
    try:
        at_s = pq.read_table(truth, columns=["time_s"])["time_s"].to_numpy()
        com_m, force_n = _read_points(truth, "com_{}_m"), _read_points(truth, "f{}_n")
    except (OSError, ValueError, KeyError) as error:
        message = f"{truth.name} is not a table of a true motion: it needs time_s, com_x_m.. and fx_n.."
        raise UnreadableFile("truth-unreadable", message) from error
    frame_s = time_s[1] - time_s[0]
    if len(at_s) < 2 or at_s[0] > time_s[0] + frame_s or at_s[-1] < time_s[-1] - frame_s:
        message = f"The truth covers {at_s.min():.2f} to {at_s.max():.2f} s, the recording lasts to {time_s[-1]:.2f} s."
        raise InvalidInput("truth-mismatch", message)

    def interpolate_track(track: TruthPoints) -> Points:
        return np.column_stack([np.interp(time_s, at_s, track[:, axis]) for axis in range(3)])

    return KnownMotion(interpolate_track(com_m), interpolate_track(force_n))


def com_errors_mm(com: Path, truth: Path) -> dict[str, tuple[float, float, float]]:
    """RMS error per axis in millimetres of the fused and the geometric CoM, over the frames in which both exist."""
    true_m = _read_points(truth, "com_{}_m")
    tracks = {"fused": _read_points(com, "{}_m"), "markers only": _read_points(com, "geometry_{}_m")}
    common = np.logical_and.reduce([np.isfinite(track).all(axis=1) for track in tracks.values()])
    errors: dict[str, tuple[float, float, float]] = {}
    for name, track in tracks.items():
        x, y, z = (float(e) for e in 1e3 * np.sqrt(np.mean((track - true_m)[common] ** 2, axis=0)))
        errors[name] = (x, y, z)
    return errors


def _read_points(table: Path, name: str) -> TruthPoints:
    columns = [name.format(axis) for axis in "xyz"]
    read = pq.read_table(table, columns=columns)
    return np.column_stack([read[column].to_numpy() for column in columns])
