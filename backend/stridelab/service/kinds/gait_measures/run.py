"""``gait-measures``: measures per step of one or more recordings.

Tables: ``measures`` (long format, a row per value, as statistics packages read it), ``xcom`` (a row per instant) and
``stability`` (a row per instant, in the world frame of the recording, for pictures).
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Final

import numpy as np

from stridelab.measures.margin_of_stability import sideways_margin_m
from stridelab.pipelines.gait_measures.pooled import GaitMeasuresResult, gait_measures
from stridelab.pipelines.gait_measures.recording import SIDES, MeasuredRecording
from stridelab.pipelines.progress import ProgressCallback
from stridelab.schemas.measures import GaitMeasuresTask
from stridelab.service.kinds.base import ArtifactFile, Outcome
from stridelab.service.kinds.result_tables import track_columns, write_table

COLUMN_UNITS: Final[Mapping[str, str]] = {
    "m": "_m",
    "s": "_s",
    "m/s": "_m_s",
    "J/kg": "_j_kg",
    "1/min": "_1_min",
    "rad/s": "_rad_s",
    "1": "",
}
"""Ends of the names of columns by the unit of their measure."""
OUTLINE_POINTS: Final = 5
"""Points of a foot's outline (``foot_outline``)."""


def run(task: GaitMeasuresTask, folder: Path, progress: ProgressCallback) -> Outcome:
    """Measure every recording of ``task``; the summary is a ``GaitMeasuresSummary``.

    Raises as ``stridelab.pipelines.gait_measures.pooled.gait_measures`` does.
    """
    result = gait_measures(task, folder, progress)
    progress(0.97, "writing the tables")
    artifacts = write_measures(folder, result)
    progress(1.0, "done")
    return Outcome(result.summary.model_dump(mode="json"), result.citation_keys, artifacts)


def write_measures(folder: Path, result: GaitMeasuresResult) -> tuple[ArtifactFile, ...]:
    """Write the tables as Parquet and CSV into ``folder``."""
    about = {"summary": result.summary.model_dump(mode="json", exclude={"measures", "trials", "warnings"})}
    tables = {
        "measures": measure_columns(result),
        "steps": step_columns(result),
        "xcom": xcom_columns(result.recordings),
        "stability": stability_columns(result.recordings),
    }
    return tuple(file for stem, columns in tables.items() for file in write_table(folder, stem, columns, about))


def measure_columns(result: GaitMeasuresResult) -> dict[str, np.ndarray]:
    """One row per value; measures over all recordings together have an empty ``recording``; NaN is unknown."""
    rows = [(one.recording_id, one.filename, m) for one in result.recordings for m in one.measures]
    rows += [("", "", measure) for measure in result.pooled]
    return {
        "recording": np.array([name for _, name, _ in rows]),
        "measure": np.array([measure.name for _, _, measure in rows]),
        "side": np.array([measure.side or "" for _, _, measure in rows]),
        "step": np.array([np.nan if measure.step is None else measure.step for _, _, measure in rows], dtype=float),
        "value": np.array([measure.value for _, _, measure in rows]),
        "sd": np.array([np.nan if measure.sd is None else measure.sd for _, _, measure in rows], dtype=float),
        "unit": np.array([measure.unit for _, _, measure in rows]),
        "recording_id": np.array([recording_id for recording_id, _, _ in rows]),
    }


def step_columns(result: GaitMeasuresResult) -> dict[str, np.ndarray]:
    """One row per step with a column per measure, as statistics packages read repeated observations; NaN is unknown.

    A stride, or the stance of a leg, is in the row of the step that it begins with. ``side`` is the foot that swings;
    the margin in single support is of the other foot, which ``side_margin_of_stability_ml_min`` names.
    """
    rows = [(one, number, step) for one in result.recordings for number, step in enumerate(one.steps)]
    columns: dict[str, np.ndarray] = {
        "recording_id": np.array([one.recording_id for one, _, _ in rows]),
        "recording": np.array([one.filename for one, _, _ in rows]),
        "step": np.array([number for _, number, _ in rows]),
        "side": np.array([step.side for _, _, step in rows]),
        "strike_s": np.array([step.strike_s for _, _, step in rows]),
        "timing": np.array([step.source for _, _, step in rows]),
    }
    values = {
        (one.recording_id, measure.step, measure.name): measure
        for one in result.recordings
        for measure in one.measures
        if measure.step is not None
    }
    for name, unit in dict.fromkeys((measure.name, measure.unit) for measure in values.values()):
        given = [values.get((one.recording_id, number, name)) for one, number, _ in rows]
        if any(one is not None and one.side != step.side for one, (_, _, step) in zip(given, rows, strict=True)):
            columns[f"side_{name}"] = np.array(["" if one is None else one.side or "" for one in given])
        label = f"{name}{COLUMN_UNITS[unit]}"
        columns[label] = np.array([np.nan if one is None else one.value for one in given])
        columns[f"sd_{label}"] = np.array([np.nan if one is None or one.sd is None else one.sd for one in given])
    return columns


def xcom_columns(recordings: tuple[MeasuredRecording, ...]) -> dict[str, np.ndarray]:
    """Extrapolated CoM in the axes of the walk (x ahead, y to the left), relative to the walking surface."""
    parts = []
    for one in recordings:
        n = len(one.motion.time_s)
        sd = np.full((n, 2), np.nan) if one.xcom.sd_m is None else one.xcom.sd_m
        parts.append(
            {
                "recording": np.array([one.filename] * n),
                "time_s": one.motion.time_s,
                "x_m": one.xcom.position_m[:, 0],
                "y_m": one.xcom.position_m[:, 1],
                "sd_x_m": sd[:, 0],
                "sd_y_m": sd[:, 1],
                "recording_id": np.array([one.recording_id] * n),
            }
        )
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def stability_columns(recordings: tuple[MeasuredRecording, ...]) -> dict[str, np.ndarray]:
    """CoM, extrapolated CoM on the floor, and the feet that stand, in the world frame of each recording.

    Of each side: the outline as five points, the margin of stability sideways and the end of this margin, from the
    extrapolated CoM to the outer edge; NaN while the foot swings. The angular momentum is that about the CoM per
    kilogram of body mass.
    """
    parts = [_stability_of(one) for one in recordings]
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def _stability_of(one: MeasuredRecording) -> dict[str, np.ndarray]:
    motion, n = one.motion, len(one.motion.time_s)
    xcom_m = np.pad(one.xcom.position_m, ((0, 0), (0, 1)))
    columns: dict[str, np.ndarray] = {
        "recording_id": np.array([one.recording_id] * n),
        "recording": np.array([one.filename] * n),
        "time_s": motion.time_s,
    }
    columns |= track_columns("{}_m", motion.in_world(motion.com_m))
    columns |= track_columns("xcom_{}_m", motion.in_world(xcom_m))
    columns |= track_columns("momentum_{}_m2_s", motion.momentum_per_kg @ motion.frame)
    for side in SIDES:
        stands = np.zeros(n, dtype=bool)
        for contact in one.contacts:
            if contact.side == side:
                stands |= (motion.time_s >= contact.start_s) & (motion.time_s <= contact.end_s)
        outline_m, margin_m = np.full((n, OUTLINE_POINTS, 3), np.nan), np.full(n, np.nan)
        if side in motion.feet:
            outline_m = np.where(stands[:, None, None], motion.feet[side].outline_m, np.nan)
            margin_m = np.where(stands, sideways_margin_m(motion, one.xcom, side), np.nan)
        outwards = np.array([0.0, 1.0 if side == "left" else -1.0, 0.0])
        columns[f"{side}_margin_m"] = margin_m
        columns |= track_columns(f"{side}_edge_{{}}_m", motion.in_world(xcom_m + margin_m[:, None] * outwards))
        for k in range(OUTLINE_POINTS):
            columns |= track_columns(f"{side}_outline{k}_{{}}_m", motion.in_world(outline_m[:, k]))
    return columns
