"""``study-population``: the wheel parameters of many subjects (section 3.3.2), a process per recording.

Recordings that cannot be fitted are listed and left out. Tables: ``subjects`` (a row per subject), ``steps`` (a row per
step), ``correlations`` (a row per pair).
"""

from functools import partial
from pathlib import Path
from typing import Final

from stridelab.machine.parallel import map_isolated
from stridelab.pipelines.population.study import study_population
from stridelab.pipelines.progress import ProgressCallback
from stridelab.schemas.population import StudyPopulationTask
from stridelab.service.kinds.base import Outcome
from stridelab.service.kinds.study_population.files import write_population
from stridelab.service.processes.sandbox import confine_piece

PRELOAD: Final = ("stridelab.pipelines.population.study",)
RECORDING_TIMEOUT_S: Final = 120.0


def run(task: StudyPopulationTask, folder: Path, progress: ProgressCallback) -> Outcome:
    """Fit every recording of ``task`` and study the subjects; the summary is a ``StudyPopulationSummary``.

    Raises as ``stridelab.pipelines.population.study.study_population`` does.
    """
    map_recordings = partial(map_isolated, preload=PRELOAD, timeout_s=RECORDING_TIMEOUT_S, confine=confine_piece)
    result = study_population(task, folder, map_recordings, progress)
    progress(0.97, "writing the tables")
    steps = [(row.step, row.fitted, result.groups[row.step.person], row.used) for row in result.steps]
    artifacts = write_population(folder, result.summary, steps)
    progress(1.0, "done")
    return Outcome(result.summary.model_dump(mode="json"), result.citation_keys, artifacts)
