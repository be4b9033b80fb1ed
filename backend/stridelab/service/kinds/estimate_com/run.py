"""``estimate-com``: estimates the centre of mass of a recording and writes it to files (chapter 2).

``com.parquet`` / ``com.csv`` cover the whole recording at the marker instants. The geometric CoM is available wherever
the markers suffice; the fused position, velocity, acceleration, standard deviation and the force are NaN outside the
window in which all contact force is measured.
"""

from pathlib import Path

from stridelab.pipelines.estimate_com import estimate_com
from stridelab.pipelines.progress import ProgressCallback
from stridelab.schemas.tasks import EstimateComTask
from stridelab.service.kinds.base import Json, Outcome
from stridelab.service.kinds.estimate_com.files import write_com_result


def run_in_child(task: Json, folder: Path, progress: ProgressCallback) -> Json:
    """``run`` with JSON on both sides."""
    return run(EstimateComTask.model_validate(task), folder, progress).to_json()


def run(task: EstimateComTask, folder: Path, progress: ProgressCallback) -> Outcome:
    """Estimate the CoM of ``task.recording`` in ``folder``; the summary is an ``EstimateComSummary``.

    Raises as ``stridelab.pipelines.estimate_com.estimate_com`` does.
    """
    result = estimate_com(task, folder, progress)
    progress(0.85, "writing the result")
    artifacts = write_com_result(folder, task.recording, result)
    progress(1.0, "done")
    return Outcome(result.summary.model_dump(mode="json"), result.citation_keys, artifacts)
