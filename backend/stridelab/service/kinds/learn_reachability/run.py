"""``learn-reachability``: learns the distribution of a robot's CoM relative to its effectors (section 4.3).

Writes ``mixtures.json`` and ``cloud.npz`` (the files of models/reachability), ``card.json`` (the card without the
mixtures' numbers), ``reachability.json`` (data for plots: ``robots.reachability``) and the table ``samples`` of the CoM
positions, one row per posture. Its child processes end with it.
"""

import json
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from stridelab.pipelines.progress import ProgressCallback
from stridelab.reachability.card import EffectorCard, ReachabilityCard
from stridelab.reachability.learning.fit import LearnedDensities, learn_densities
from stridelab.reachability.store import card_json, save_card, save_cloud
from stridelab.robots.card import robot_card
from stridelab.robots.loader import load_robot
from stridelab.robots.robot import Robot
from stridelab.schemas.base import Remark
from stridelab.schemas.plans import LearnedEffector, LearnReachabilitySummary
from stridelab.schemas.tasks import LearnReachabilityTask
from stridelab.service.kinds.base import ArtifactFile, Json, Outcome
from stridelab.service.kinds.result_tables import write_atomically, write_table, write_text_atomically
from stridelab.service.kinds.robots.reachability import plottable_reachability

MIXTURES_FILE, CARD_FILE, JSON = "mixtures.json", "card.json", "application/json"
CLOUD_FILE, NPZ = "cloud.npz", "application/x-npz"
SHAPES_FILE: Final = "reachability.json"
MIN_SAMPLES: Final = 5000
"""Number of samples below which the densities of two seeds differ visibly."""
LEARNING_SHARE: Final = 0.95
REFERENCES: Final = (
    "carpentier2017thesis",
    "carpentier2018multicontact",
    "carpentier2019pinocchio",
    "dempster1977em",
    "hershey2007kl",
    "scott1992density",
    "pedregosa2011sklearn",
)


def run_in_child(task: Json, folder: Path, progress: ProgressCallback) -> Json:
    """``run`` with JSON on both sides."""
    return run(LearnReachabilityTask.model_validate(task), folder, progress).to_json()


def run(task: LearnReachabilityTask, folder: Path, progress: ProgressCallback) -> Outcome:
    """Learn into ``folder``; the summary is a ``LearnReachabilitySummary``.

    Raises ``NotFound`` (``robot-not-found``, ``effector-not-found``), ``Unavailable`` (``robot-data-missing``),
    ``NotEstimable`` (``measure-unavailable``, ``no-free-configuration``).
    """
    request = task.input
    progress(0.0, "loading the robot")
    robot = load_robot(request.robot)

    def report_learning(fraction: float, message: str) -> None:
        progress(LEARNING_SHARE * fraction, message)

    today = datetime.now(UTC).date()
    learned = learn_densities(
        robot, today, request.effectors, request.samples, request.seed, request.measure, report_learning
    )
    progress(LEARNING_SHARE, "writing the densities")
    provenance = {"input": request.model_dump(mode="json"), "robot_sha256": robot.sha256}
    artifacts = _write_files(robot, learned, folder, provenance)
    card = learned.card
    summary = LearnReachabilitySummary(
        robot=card.robot,
        robot_sha256=card.robot_sha256,
        samples=card.samples,
        tried=card.tried,
        rejected_share=card.rejected_share,
        learned_on=card.learned_on,
        measure=card.measure,
        effectors={name: _learned_effector(effector) for name, effector in card.effectors.items()},
        warnings=list(_card_warnings(card)),
    )
    progress(1.0, "done")
    references = (*REFERENCES, *robot_card(robot.name).references)
    return Outcome(summary.model_dump(mode="json"), references, artifacts)


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


def _learned_effector(effector: EffectorCard) -> LearnedEffector:
    return LearnedEffector(
        frame=effector.frame,
        components=effector.components,
        thesis_components=effector.thesis_components,
        kl_nats=effector.kl_nats,
        kl_sd_nats=effector.kl_sd_nats,
        held_out_log_likelihood=effector.held_out_log_likelihood,
        bandwidth_m=effector.bandwidth_m,
        mode_m=effector.mode_m,
    )


def _card_warnings(card: ReachabilityCard) -> tuple[Remark, ...]:
    remarks = []
    if card.samples < MIN_SAMPLES:
        message = f"{card.samples} samples give a rough density; the thesis uses 20000."
        remarks.append(Remark(code="few-samples", message=message))
    for name, effector in card.effectors.items():
        if not effector.em_converged:
            message = f"The fit of {name} stopped before it met its tolerance."
            remarks.append(Remark(code="fit-not-converged", message=message))
    return tuple(remarks)
