"""``push-basin``: replays a motion in physics with one push at a time.

Writes ``pushes`` (Parquet and CSV), one row per push in the order of the draws. Its child processes end with it.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from stridelab.pipelines.progress import ProgressCallback
from stridelab.pipelines.replays.push_basin import PushResult, push_basin
from stridelab.schemas.receding import PushBasinTask
from stridelab.service.kinds.base import Outcome
from stridelab.service.kinds.result_tables import write_table


def run(task: PushBasinTask, folder: Path, progress: ProgressCallback) -> Outcome:
    """Replay every push and write the table into ``folder``; the summary is a ``PushBasinSummary``.

    Raises as ``stridelab.pipelines.replays.push_basin.push_basin`` does.
    """
    result = push_basin(task, progress)
    about = {"scenario": result.summary.scenario_name, "robot": result.summary.robot, "seed": result.summary.seed}
    files = write_table(folder, "pushes", push_columns(result.pushes, result.summary.speed_m_s), about)
    progress(1.0, "done")
    return Outcome(result.summary.model_dump(mode="json"), result.citation_keys, files)


def push_columns(pushes: Sequence[PushResult], speed_m_s: float) -> dict[str, np.ndarray]:
    """Columns of ``pushes``; ``fall_time_s`` is NaN without a fall."""
    names = ("time_s", "direction_rad", "phase", "outcome", "arrived", "completed", "reason", "fall_time_s")
    measured = ("com_error_max_m", "slip_max_m", "torque_ratio_max")
    columns = {name: np.array([getattr(push, name) for push in pushes]) for name in (*names, *measured)}
    return {"push": np.arange(len(pushes)), "speed_m_s": np.full(len(pushes), speed_m_s)} | columns
