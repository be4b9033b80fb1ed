"""``fit-cycloid``: fits the rolling wheel of every step of a recording (chapter 3)."""

from pathlib import Path

from stridelab.pipelines.fit_cycloid import fit_cycloid_of_recording
from stridelab.pipelines.progress import ProgressCallback
from stridelab.schemas.cycloid import FitCycloidTask
from stridelab.service.kinds.base import Outcome
from stridelab.service.kinds.fit_cycloid.files import write_cycloid


def run(task: FitCycloidTask, folder: Path, progress: ProgressCallback) -> Outcome:
    """Fit the wheel of every step of ``task.recording`` in ``folder``; the summary is a ``FitCycloidSummary``.

    Raises as ``fit_cycloid_of_recording`` does.
    """
    result = fit_cycloid_of_recording(task, folder, progress)
    progress(0.95, "writing the result")
    artifacts = write_cycloid(folder, task.recording, result)
    progress(1.0, "done")
    return Outcome(result.summary.model_dump(mode="json"), result.citation_keys, artifacts)
