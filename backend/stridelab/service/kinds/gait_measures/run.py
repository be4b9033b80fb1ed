"""``gait-measures``: measures per step of one or more recordings.

Tables: ``measures`` (long format, a row per value, as statistics packages read it) and ``xcom`` (a row per instant).
"""

from pathlib import Path

import numpy as np

from stridelab.measures.measure import Measure
from stridelab.pipelines.gait_measures import GaitMeasuresResult, MeasuredRecording, gait_measures
from stridelab.pipelines.progress import ProgressCallback
from stridelab.schemas.tasks import GaitMeasuresTask
from stridelab.service.kinds.base import ArtifactFile, Outcome, json_run
from stridelab.service.kinds.result_tables import write_table


def run(task: GaitMeasuresTask, folder: Path, progress: ProgressCallback) -> Outcome:
    """Measure every recording of ``task``; the summary is a ``GaitMeasuresSummary``.

    Raises as ``stridelab.pipelines.gait_measures.gait_measures`` does.
    """
    result = gait_measures(task, folder, progress)
    progress(0.97, "writing the tables")
    artifacts = write_measures(folder, result)
    progress(1.0, "done")
    return Outcome(result.summary.model_dump(mode="json"), result.citation_keys, artifacts)


run_in_child = json_run(GaitMeasuresTask, run)


def write_measures(folder: Path, result: GaitMeasuresResult) -> tuple[ArtifactFile, ...]:
    """Write both tables as Parquet and CSV into ``folder``."""
    about = {"summary": result.summary.model_dump(mode="json", exclude={"measures", "trials", "warnings"})}
    tables = {"measures": measure_columns(result), "xcom": xcom_columns(result.recordings)}
    return tuple(file for stem, columns in tables.items() for file in write_table(folder, stem, columns, about))


def measure_columns(result: GaitMeasuresResult) -> dict[str, np.ndarray]:
    """One row per value; measures over all recordings together have an empty ``recording``; NaN is unknown."""
    rows: list[tuple[str, Measure]] = [(one.filename, m) for one in result.recordings for m in one.measures]
    rows += [("", measure) for measure in result.pooled]
    return {
        "recording": np.array([name for name, _ in rows]),
        "measure": np.array([measure.name for _, measure in rows]),
        "side": np.array([measure.side or "" for _, measure in rows]),
        "step": np.array([np.nan if measure.step is None else measure.step for _, measure in rows], dtype=float),
        "value": np.array([measure.value for _, measure in rows]),
        "sd": np.array([np.nan if measure.sd is None else measure.sd for _, measure in rows], dtype=float),
        "unit": np.array([measure.unit for _, measure in rows]),
    }


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
            }
        )
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
