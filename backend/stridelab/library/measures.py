"""``sl.gait_measures``: margins of stability, steps, energy, work and angular momentum of a walk."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from stridelab.library.options import Progress, data_frame, ignore_progress, validate_fields
from stridelab.library.recordings import LoadedRecording, load_recording, staged_sources
from stridelab.pipelines.gait_measures import GaitMeasuresResult
from stridelab.pipelines.gait_measures import gait_measures as _gait_measures
from stridelab.schemas.jobs import EstimateComInput
from stridelab.schemas.measures import GaitMeasuresInput, GaitMeasuresSummary
from stridelab.schemas.tasks import EstimateComTask, GaitMeasuresTask, MeasuresMember


@dataclass(frozen=True)
class GaitMeasures:
    """Measures of gait per step of a recording, from ``gait_measures``."""

    loaded: LoadedRecording
    request: GaitMeasuresInput
    result: GaitMeasuresResult

    @property
    def summary(self) -> GaitMeasuresSummary:
        """The summary of the job ``gait-measures``: means per measure and side, and what cannot be measured."""
        return self.result.summary

    def to_dataframe(self) -> Any:
        """One row per value, as a data frame of pandas, or of polars if pandas is not installed.

        Raises:
            Unavailable: ``dataframe-unavailable`` where neither pandas nor polars is installed.
        """
        from stridelab.service.kinds.gait_measures.run import measure_columns

        return data_frame(measure_columns(self.result))

    def save(self, folder: str | Path, *, replace: bool = False) -> Path:
        """Write the files of the job into a folder: ``measures`` and ``xcom`` as CSV and Parquet, ``result.json``.

        Raises:
            Conflict: ``output-exists`` where the folder exists; ``replace`` allows it for an earlier result.
        """
        from stridelab.cli.results import result_folder, write_result
        from stridelab.service.kinds.base import Outcome
        from stridelab.service.kinds.gait_measures.run import write_measures

        with result_folder(Path(folder), force=replace) as made:
            artifacts = write_measures(made, self.result)
            outcome = Outcome(self.summary.model_dump(mode="json"), self.result.citation_keys, artifacts)
            write_result(made, "gait-measures", self.request, outcome)
        return Path(folder)


def gait_measures(
    recording: LoadedRecording | str | Path,
    *,
    method: str | None = None,
    progress: Progress | None = None,
    **stated: Any,
) -> GaitMeasures:
    """Measures of gait per step: margins of stability, steps, energy, work of the legs, angular momentum.

    Args:
        recording: Result of ``read``, or a path; ``stated`` are then options of ``read``.
        method: An estimator of the centre of mass by name; None takes the best one.
        progress: Called with a fraction from 0 to 1 and a message.

    Raises:
        NotEstimable: The recording is not a walk, or contains no whole step; code and message say what is missing.
    """
    loaded = load_recording(recording, stated)
    request = validate_fields(GaitMeasuresInput, {"recording_ids": [loaded.path.name], "method": method})
    one = validate_fields(EstimateComInput, {"recording_id": loaded.path.name, "method": method})
    with staged_sources(loaded) as (folder, recorded, static):
        task = EstimateComTask(recording=recorded, static=static, input=one)
        member = MeasuresMember(recording_id=loaded.path.name, folder=".", task=task)
        measured = _gait_measures(GaitMeasuresTask(members=[member]), folder, progress or ignore_progress)
        return GaitMeasures(loaded, request, measured)
