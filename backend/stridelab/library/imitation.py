"""``sl.imitate``: a robot walks as the person of a recording."""

import shutil
import tempfile
import weakref
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from stridelab.library.options import Progress, data_frame, ignore_progress, validate_fields
from stridelab.library.recordings import LoadedRecording, load_recording, staged_sources
from stridelab.pipelines.imitation.imitate import imitate as _imitate
from stridelab.schemas.imitation.contract import ImitateInput, ImitateSummary, ImitateTask


@dataclass(frozen=True)
class ImitatedWalk:
    """A robot's imitation of a recorded walk, from ``imitate``: the summary of the job and the folder with its files.

    The folder is temporary and deleted with this object; ``save`` copies it.
    """

    summary: ImitateSummary
    folder: Path

    def save(self, folder: str | Path, *, replace: bool = False) -> Path:
        """Copy the files of the job into a folder.

        Raises:
            Conflict: ``output-exists`` where the folder exists; ``replace`` allows it for an earlier result.
        """
        from stridelab.service.local_runs import result_folder

        with result_folder(Path(folder), force=replace) as made:
            shutil.copytree(self.folder, made, dirs_exist_ok=True)
        return Path(folder)

    def to_dataframe(self) -> Any:
        """Person and robot, one row per quantity (``comparison.csv``).

        Raises:
            Unavailable: ``dataframe-unavailable`` where neither pandas nor polars is installed.
        """
        import pyarrow.parquet as pq

        table = pq.read_table(self.folder / "comparison.parquet")
        return data_frame({name: table.column(name).to_numpy() for name in table.column_names})


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
        NotEstimable: The recording is no level walk (``stairs``, ``running``, ``turning``, ``standing``), too short
            (``too-few-footholds``), or no pace is certified (``imitation-not-certified``); the faults say why.
        NotFound: ``robot-not-found``.
    """
    from stridelab.service.kinds.imitate import run as job
    from stridelab.service.local_runs import write_result

    loaded = load_recording(recording, stated)
    fields = {"recording_id": loaded.path.name, "robot": robot, "wheel": wheel, "method": method}
    fields |= {"step_share": step_share, "pace": pace}
    request = validate_fields(ImitateInput, fields)
    folder = Path(tempfile.mkdtemp(prefix="stridelab-imitation-"))
    try:
        with staged_sources(loaded) as (sources, recorded, static):
            task = ImitateTask(recording=recorded, static=static, input=request)
            result = _imitate(task, sources, progress or ignore_progress)
        outcome = job.publish_imitation(folder, result, progress or ignore_progress)
        write_result(folder, "imitate", request, outcome)
    except BaseException:
        shutil.rmtree(folder, ignore_errors=True)
        raise
    walk = ImitatedWalk(result.summary, folder)
    weakref.finalize(walk, shutil.rmtree, folder, ignore_errors=True)
    return walk
