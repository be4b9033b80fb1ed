"""``com-bench``: scores of all estimators on many recordings, a process per recording.

Table: ``scores`` (long format, a row per recording, score and method; mean squares, or shares of samples).
"""

from functools import partial
from pathlib import Path
from typing import Final

import numpy as np

from stridelab.estimation.evaluation.unseen_scores import SCORES
from stridelab.machine.parallel import map_isolated
from stridelab.pipelines.bench_estimators import REFERENCES, ComBenchResult, bench_estimators
from stridelab.pipelines.progress import ItemMap, ProgressCallback
from stridelab.schemas.comparison import ComBenchTask
from stridelab.service.kinds.base import ArtifactFile, Outcome
from stridelab.service.kinds.result_tables import write_table
from stridelab.service.processes.sandbox import confine_piece

RECORDING_TIMEOUT_S: Final = 600.0
map_recordings: Final = partial(
    map_isolated,
    preload=("stridelab.pipelines.bench_estimators",),
    timeout_s=RECORDING_TIMEOUT_S,
    confine=confine_piece,
)


def run(task: ComBenchTask, folder: Path, progress: ProgressCallback, items: ItemMap = map_recordings) -> Outcome:
    """Score every recording of ``task``; the summary is a ``ComBenchSummary``.

    Raises as ``stridelab.pipelines.bench_estimators.bench_estimators`` does.
    """
    result = bench_estimators(task, folder, items, progress)
    progress(0.97, "writing the table")
    about = {"summary": result.summary.model_dump(mode="json", include={"n_recordings", "n_people"})}
    artifacts: tuple[ArtifactFile, ...] = tuple(write_table(folder, "scores", score_columns(result), about))
    progress(1.0, "done")
    return Outcome(result.summary.model_dump(mode="json"), REFERENCES, artifacts)


def score_columns(result: ComBenchResult) -> dict[str, np.ndarray]:
    """One row per recording, score and method, in the order of the recordings."""
    rows = [
        (filename, row.person, f"{row.movement}_{score}", method, value, _unit(score))
        for filename, row in result.rows
        for score, of_methods in row.scores.items()
        for method, value in of_methods.items()
    ]
    names = ("recording", "subject", "column", "method", "value", "unit")
    return {name: np.array([row[k] for row in rows]) for k, name in enumerate(names)}


def _unit(score: str) -> str:
    return "m^2" if SCORES[score].unit == "m" else "1"
