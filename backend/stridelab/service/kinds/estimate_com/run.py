"""``estimate-com``: estimates the centre of mass of a recording and writes it to files (chapter 2).

``com.parquet`` / ``com.csv`` cover the whole recording at the marker instants. The geometric CoM is available wherever
the markers suffice; the fused position, velocity, acceleration, standard deviation and the force are NaN outside the
window in which all contact force is measured.

The files of ``estimate-com``: ``com.parquet``, ``com.csv`` and ``com.c3d``.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

from stridelab.body.geometric_com import GeometricCom
from stridelab.conventions import Mask, Points, Series
from stridelab.dynamics.wrench import Wrench, central_axis
from stridelab.estimation.estimator import ComEstimate
from stridelab.estimation.observability import observability_track
from stridelab.pipelines.estimate_com import ComResult, estimate_com
from stridelab.pipelines.progress import ProgressCallback
from stridelab.pipelines.trial import Trial
from stridelab.recordings.files.c3d import add_points_to_c3d
from stridelab.recordings.files.c3d_writer import write_c3d
from stridelab.recordings.reader import is_c3d
from stridelab.recordings.recording import WrenchTrack
from stridelab.schemas.jobs import EstimateComSummary
from stridelab.schemas.tasks import EstimateComTask, RecordingSource
from stridelab.service.kinds.base import ArtifactFile, Outcome
from stridelab.service.kinds.result_tables import C3D, write_atomically, write_table


def run(task: EstimateComTask, folder: Path, progress: ProgressCallback) -> Outcome:
    """Estimate the CoM of ``task.recording`` in ``folder``; the summary is an ``EstimateComSummary``.

    Raises as ``stridelab.pipelines.estimate_com.estimate_com`` does.
    """
    result = estimate_com(task, folder, progress)
    progress(0.85, "writing the result")
    artifacts = write_com_result(folder, task.recording, result)
    progress(1.0, "done")
    return Outcome(result.summary.model_dump(mode="json"), result.citation_keys, artifacts)


AXES = "xyz"
COM_POINT, GEOMETRY_POINT = "COM", "COM_GEOMETRY"
"""Names of the points added to ``com.c3d``."""


def write_com_result(folder: Path, source: RecordingSource, result: ComResult) -> tuple[ArtifactFile, ...]:
    """Write all files of ``result`` into ``folder``, which contains the recording's own file."""
    prepared, wrench = result.prepared, result.prepared.wrench
    if not prepared.windows:  # the placeholder of a missing wrench is not a measurement
        wrench = replace(wrench, complete=np.zeros_like(wrench.complete))
    return write_com(folder, source, prepared.trial, prepared.geometric, wrench, result.estimate, result.summary)


def write_com(
    folder: Path,
    source: RecordingSource,
    trial: Trial,
    geometric: GeometricCom,
    wrench: WrenchTrack,
    estimate: ComEstimate,
    summary: EstimateComSummary,
) -> tuple[ArtifactFile, ...]:
    """Write all files of a result into ``folder``."""
    columns = com_columns(geometric, wrench, estimate)
    provenance = {"file": source.filename, "frame": "world, z up", "summary": summary.model_dump(mode="json")}
    tables = write_table(folder, "com", columns, provenance)
    fused = np.column_stack([columns[f"{axis}_m"] for axis in AXES])
    write_com_c3d(folder / "com.c3d", folder / source.file, trial, {COM_POINT: fused, GEOMETRY_POINT: geometric.com_m})
    return (*tables, ArtifactFile("com.c3d", C3D))


def com_columns(geometric: GeometricCom, wrench: WrenchTrack, estimate: ComEstimate) -> dict[str, Series | Mask]:
    """Columns of ``com`` at the instants of ``geometric``; columns of the window are NaN outside it.

    They contain the three inputs of section 2.4.1: (i) ``geometry_x_m`` .., (ii) ``force_x_n`` .., and (iii)
    ``axis_x_m`` .., the projection (2.12) of (i) onto the central axis, a line along the force; NaN where the force is
    too small to define the axis. ``unobservable_x`` .. is the unit vector along which the position is not observable
    from the force (NaN in flight, where no direction is observable), ``rank_force`` of 9 and ``rank_with_geometry`` of
    12 are the ranks of (2.19) and (2.23). ``complete`` marks the frames at which the whole force is measured.
    """
    n = len(geometric.time_s)
    first = int(np.argmin(np.abs(geometric.time_s - estimate.time_s[0])))
    inside = slice(first, first + len(estimate.time_s))
    columns: dict[str, Series | Mask] = {"time_s": geometric.time_s}
    for suffix, name, track in (
        ("m", "", estimate.com_m),
        ("m_s", "v", estimate.velocity_m_s),
        ("m_s2", "a", estimate.acceleration_m_s2),
        ("m", "sd_", estimate.sd_m),
    ):
        columns |= _axis_columns(name, suffix, _spread_over_frames(track, inside, n))
    columns |= _axis_columns("geometry_", "m", geometric.com_m)
    force_n = np.where(wrench.complete[:, None], wrench.force_n, np.nan)
    columns |= _axis_columns("force_", "n", force_n)
    columns |= _axis_columns("axis_", "m", central_axis(Wrench(force_n, wrench.moment_nm)).project(geometric.com_m))
    seen = observability_track(estimate)
    whole = wrench.complete[inside]
    columns |= _axis_columns(
        "unobservable_", "", _spread_over_frames(np.where(whole[:, None], seen.direction, np.nan), inside, n)
    )
    for name, ranks in (("rank_force", seen.rank_force), ("rank_with_geometry", seen.rank_with_geometry)):
        columns[name] = np.full(n, np.nan)
        columns[name][inside] = np.where(whole, ranks, np.nan)
    columns["complete"] = wrench.complete
    return columns


def write_com_c3d(target: Path, upload: Path, trial: Trial, points: dict[str, Points]) -> None:
    """Write the upload with the CoM added as points.

    An upload in another format than C3D (TRC, or a zip of TRC and MOT) is written as a new C3D file: its markers in
    millimetres and world axes, and its contacts, if any, as plates.
    """
    if is_c3d(upload):
        write_atomically(target, lambda path: add_points_to_c3d(upload, path, points, trial.recording.up_axis))
    else:
        write_atomically(target, lambda path: write_c3d(path, trial.recording, extra_points=points))


def _axis_columns(prefix: str, suffix: str, track: Points) -> dict[str, Series | Mask]:
    unit = f"_{suffix}" if suffix else ""
    return {f"{prefix}{axis}{unit}": track[:, i] for i, axis in enumerate(AXES)}


def _spread_over_frames(track: Points, inside: slice, n_frames: int) -> Float[np.ndarray, "n_frames 3"]:
    """The track of a window in an array of all frames, NaN outside."""
    whole = np.full((n_frames, 3), np.nan)
    whole[inside] = track
    return whole
