"""``imitate``: a person's walk as that of a robot; the files of ``plan-motion``, and those of the comparison.

Further tables: ``comparison`` (one row per quantity), ``curves`` (both walks over a step) and ``person`` (points of the
person in the robot's scene and on its clock).
"""

from pathlib import Path

import numpy as np

from stridelab.pipelines.imitation.imitate import ImitationResult, imitate
from stridelab.pipelines.progress import ProgressCallback
from stridelab.schemas.imitation.contract import ImitateTask
from stridelab.service.kinds.base import ArtifactFile, Outcome
from stridelab.service.kinds.plan_motion.files import write_json, write_motion, write_plan, write_replay
from stridelab.service.kinds.result_tables import write_table


def run(task: ImitateTask, folder: Path, progress: ProgressCallback) -> Outcome:
    """Let the robot imitate ``task.recording`` in ``folder``; the summary is an ``ImitateSummary``.

    Raises as ``stridelab.pipelines.imitation.imitate.imitate`` does.
    """
    return publish_imitation(folder, imitate(task, folder, progress), progress)


def publish_imitation(folder: Path, result: ImitationResult, progress: ProgressCallback) -> Outcome:
    """Write the files of ``result`` into ``folder``; 0.9 to 1 of the progress."""
    artifacts = write_imitation(folder, result, lambda share, text: progress(0.9 + 0.1 * share, text))
    progress(1.0, "done")
    return Outcome(result.summary.model_dump(mode="json"), result.citation_keys, artifacts)


def write_imitation(folder: Path, result: ImitationResult, progress: ProgressCallback) -> tuple[ArtifactFile, ...]:
    """Write all files into ``folder``."""
    plan, summary = result.result, result.summary
    about = {"file": summary.filename, "robot": summary.robot, "pace": summary.pace, "step_share": summary.step_share}
    return (
        write_json(folder, "certificate.json", summary.certificate),
        write_json(folder, "scenario.json", summary.scenario),
        *write_table(folder, "comparison", comparison_columns(result), about),
        *write_table(folder, "curves", result.curves, about),
        *(write_table(folder, "person", result.person_tracks, about) if result.person_tracks else ()),
        *write_plan(folder, plan.plan),
        *write_motion(folder, plan.robot, result.motion),
        *write_replay(folder, plan.robot, result.motion, result.replay),
    )


def comparison_columns(result: ImitationResult) -> dict[str, np.ndarray]:
    """One row per quantity; NaN is unknown."""
    rows = result.summary.comparison
    columns: dict[str, np.ndarray] = {name: np.array([getattr(row, name) for row in rows]) for name in ("name", "unit")}
    for name in ("person", "scaled", "robot"):
        columns[name] = np.array([getattr(row, name) for row in rows], dtype=float)
    return columns | {name: np.array([getattr(row, name) for row in rows]) for name in ("n_person", "n_robot")}
