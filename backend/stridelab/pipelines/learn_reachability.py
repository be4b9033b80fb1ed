"""From a robot to the learned distributions of its CoM relative to its effectors (section 4.3)."""

from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Final

from stridelab.pipelines.progress import ProgressCallback
from stridelab.reachability.card import ReachabilityCard
from stridelab.reachability.learning.fit import LearnedDensities, learn_densities
from stridelab.robots.card import robot_card
from stridelab.robots.loader import load_robot
from stridelab.robots.robot import Robot
from stridelab.schemas.base import Remark
from stridelab.schemas.robots import LearnedEffector, LearnReachabilityInput, LearnReachabilitySummary

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


@dataclass(frozen=True)
class LearnedReachability:
    """The learned densities of a robot, and the summary of the contract."""

    robot: Robot
    learned: LearnedDensities
    summary: LearnReachabilitySummary

    @property
    def citation_keys(self) -> tuple[str, ...]:
        """Citation keys of the method and the robot."""
        return (*REFERENCES, *robot_card(self.robot.name).references)


def learn_reachability(request: LearnReachabilityInput, progress: ProgressCallback) -> LearnedReachability:
    """Learn the densities of ``request``; its child processes end with it.

    Raises ``NotFound`` (``robot-not-found``, ``effector-not-found``), ``Unavailable`` (``robot-data-missing``),
    ``NotEstimable`` (``measure-unavailable``, ``no-free-configuration``).
    """
    progress(0.0, "loading the robot")
    robot = load_robot(request.robot)

    def report_learning(fraction: float, message: str) -> None:
        progress(LEARNING_SHARE * fraction, message)

    today = datetime.now(UTC).date()
    learned = learn_densities(
        robot, today, request.effectors, request.samples, request.seed, request.measure, report_learning
    )
    card = learned.card
    effectors = {name: LearnedEffector.from_object(effector) for name, effector in card.effectors.items()}
    summary = LearnReachabilitySummary.from_object(card, effectors=effectors, warnings=list(_card_warnings(card)))
    return LearnedReachability(robot, learned, summary)


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
