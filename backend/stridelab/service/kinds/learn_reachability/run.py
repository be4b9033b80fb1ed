"""``learn-reachability``: learns the distribution of a robot's CoM relative to its effectors (section 4.3).

Writes ``mixtures.json`` and ``cloud.npz`` (the files of models/reachability), ``card.json`` (the card without the
mixtures' numbers), ``reachability.json`` (data for plots: ``robots.reachability``) and the table ``samples`` of the CoM
positions, one row per posture. Its child processes end with it.
"""

import json
from pathlib import Path
from typing import Final

from stridelab.pipelines.learn_reachability import LEARNING_SHARE, learn_reachability
from stridelab.pipelines.progress import ProgressCallback
from stridelab.reachability.card import ReachabilityCard
from stridelab.reachability.learning.fit import LearnedDensities
from stridelab.reachability.store import card_json, save_card, save_cloud
from stridelab.robots.robot import Robot
from stridelab.schemas.robots import LearnReachabilityTask
from stridelab.service.kinds.base import ArtifactFile, Json, Outcome
from stridelab.service.kinds.result_tables import write_atomically, write_table, write_text_atomically
from stridelab.service.kinds.robots.reachability import plottable_reachability

MIXTURES_FILE, CARD_FILE, JSON = "mixtures.json", "card.json", "application/json"
CLOUD_FILE, NPZ = "cloud.npz", "application/x-npz"
SHAPES_FILE: Final = "reachability.json"


def run(task: LearnReachabilityTask, folder: Path, progress: ProgressCallback) -> Outcome:
    """Learn into ``folder``; the summary is a ``LearnReachabilitySummary``.

    Raises as ``stridelab.pipelines.learn_reachability.learn_reachability`` does.
    """
    result = learn_reachability(task.input, progress)
    progress(LEARNING_SHARE, "writing the densities")
    provenance = {"input": task.input.model_dump(mode="json"), "robot_sha256": result.robot.sha256}
    artifacts = _write_files(result.robot, result.learned, folder, provenance)
    progress(1.0, "done")
    return Outcome(result.summary.model_dump(mode="json"), result.citation_keys, artifacts)


def _write_files(robot: Robot, learned: LearnedDensities, folder: Path, provenance: Json) -> tuple[ArtifactFile, ...]:
    write_atomically(folder / MIXTURES_FILE, lambda path: save_card(path, learned.card))
    write_atomically(folder / CLOUD_FILE, lambda path: save_cloud(path, learned.cloud.com_m))
    facts = json.dumps(without_mixtures(learned.card), indent=1)
    write_text_atomically(folder / CARD_FILE, facts + "\n")
    shapes = plottable_reachability(robot, learned.card, learned.cloud.com_m)
    write_text_atomically(folder / SHAPES_FILE, shapes.model_dump_json())
    columns = {
        f"{name}_com_{axis}_m": com_m[:, i]
        for name, com_m in learned.cloud.com_m.items()
        for i, axis in enumerate(("x", "y", "z"))
    }
    frames = {"frame": {name: f"the {frame} frame of the effector" for name, frame in learned.cloud.frames.items()}}
    return (
        ArtifactFile(MIXTURES_FILE, JSON),
        ArtifactFile(CLOUD_FILE, NPZ),
        ArtifactFile(CARD_FILE, JSON),
        ArtifactFile(SHAPES_FILE, JSON),
        *write_table(folder, "samples", columns, provenance | frames),
    )


def without_mixtures(card: ReachabilityCard) -> Json:
    """Settings and quality of the learned densities: the card without the mixtures' parameters."""
    facts: Json = json.loads(card_json(card))
    for effector in facts["effectors"].values():
        for numbers in ("weights", "means", "covariances"):
            del effector[numbers]
    return facts
