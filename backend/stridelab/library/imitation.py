"""``sl.imitate``: a robot walks as the person of a recording."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from stridelab.library.job_files import JobFiles, job_folder
from stridelab.library.options import Progress, ignore_progress, validate_fields
from stridelab.library.recordings import LoadedRecording, load_recording, staged_sources
from stridelab.pipelines.imitation.imitate import imitate as _imitate
from stridelab.schemas.imitation.contract import ImitateInput, ImitateSummary, ImitateTask


@dataclass(frozen=True)
class ImitatedWalk(JobFiles):
    """A robot's imitation of a recorded walk, from ``imitate``: the summary of the job and the folder with its files.

    ``to_dataframe`` compares person and robot, one row per quantity (``comparison.csv``).
    """

    table: ClassVar[str] = "comparison.parquet"

    summary: ImitateSummary


def imitate(
    recording: LoadedRecording | str | Path,
    *,
    robot: str,
    step_share: float | None = None,
    pace: float | None = None,
    wheel: bool = True,
    method: str | None = None,
    progress: Progress | None = None,
    **stated: Any,
) -> ImitatedWalk:
    """Let a robot walk as the person of a recording, certified and replayed in physics, and compare both walks.

    Args:
        recording: Result of ``read``, or a path; ``stated`` are then options of ``read``, such as ``mass_kg``.
        robot: Name of the robot, such as "talos".
        step_share: Length of the steps over those scaled by the height of the hips; None searches the longest.
        pace: Pace over the scaled one; None searches the fastest.
        wheel: Plan the walk also with the person's rolling wheel as reference.
        method: An estimator of the person's centre of mass by name; None takes the best one.
        progress: Called with a fraction from 0 to 1 and a message.

    Raises:
        NotEstimable: The recording is no straight walk (``running``, ``turning``, ``standing``), too short
            (``too-few-footholds``), or no pace is certified (``imitation-not-certified``); the faults say why.
        NotFound: ``robot-not-found``.
    """
    from stridelab.service.kinds.imitate import run as job
    from stridelab.service.local_runs import write_result

    loaded = load_recording(recording, stated)
    fields = {"recording_id": loaded.path.name, "robot": robot, "wheel": wheel, "method": method}
    fields |= {"step_share": step_share, "pace": pace}
    request = validate_fields(ImitateInput, fields)
    with job_folder() as folder:
        with staged_sources(loaded) as (sources, recorded, static):
            task = ImitateTask(recording=recorded, static=static, input=request)
            result = _imitate(task, sources, progress or ignore_progress)
        outcome = job.publish_imitation(folder, result, progress or ignore_progress)
        write_result(folder, "imitate", request, outcome)
    return ImitatedWalk(folder, result.summary)
