"""Describes a robot: the facts of the contract, from its model and its reachability cards.

Runs in a killable child of ``GET /robots/{name}``: the service itself never imports a rigid-body library.
"""

from pathlib import Path
from typing import Final, get_args

import pinocchio as pin

from stridelab.errors import NotFound
from stridelab.pipelines.commissioning.robot_walker import walker_facts
from stridelab.pipelines.progress import ProgressCallback
from stridelab.reachability.card import Measure, ReachabilityCard
from stridelab.reachability.store import DEFAULT_MEASURE, load_card
from stridelab.robots.loader import load_robot
from stridelab.robots.robot import Effector, Robot
from stridelab.robots.visuals import link_names, link_poses
from stridelab.schemas.base import Contract
from stridelab.schemas.robots import JointLimits, ProxyCard, ProxySize, RobotEffector, RobotFacts
from stridelab.service.kinds.base import Outcome

CARD_FIELDS: Final = ("measure", "samples", "tried", "rejected_share", "seed", "learned_on", "versions")
"""Fields of a ``ProxyCard`` that all effectors of a robot share."""


class RobotTask(Contract):
    """Task of ``robots.description`` and ``robots.links``."""

    robot: str


def run(task: RobotTask, _folder: Path, progress: ProgressCallback) -> Outcome:
    """Describe the robot; the summary is a ``RobotFacts``.

    Raises ``NotFound`` (``robot-not-found``) or ``Unavailable`` (``robot-data-missing``, ``robot-data-unreadable``),
    ``UnreadableFile`` (``reachability-damaged``).
    """
    progress(0.1, "loading the robot")
    robot = load_robot(task.robot)
    progress(1.0, "done")
    return Outcome(robot_facts(robot).model_dump(mode="json"), (), ())


def robot_facts(robot: Robot) -> RobotFacts:
    """The facts of the contract; ``proxies`` is empty for a robot without learned reachability."""
    model, all_cards = robot.model, learned_cards(robot.name)
    cards = [card for card in all_cards if card.robot_sha256 == robot.sha256]
    com_m = pin.centerOfMass(model, model.createData(), robot.q_reference)
    return RobotFacts(
        name=robot.name,
        title=robot.title,
        mass_kg=robot.mass_kg,
        licence=robot.licence,
        sha256=robot.sha256,
        effectors=[effector_facts(effector) for effector in robot.effectors.values()],
        q_reference=robot.q_reference.tolist(),
        com_height_m=float(com_m[2]),  # the reference posture stands on z = 0
        limits=[joint_limits(robot, i) for i in range(len(robot.joint_names))],
        links=list(link_names(robot)),
        link_poses=link_poses(robot, robot.q_reference).tolist(),
        proxies=[proxy_card(card, effector) for card in cards for effector in card.effectors],
        measures=[card.measure for card in cards],
        stale_measures=[card.measure for card in all_cards if card not in cards],
        default_measure=DEFAULT_MEASURE,
        walker=walker_facts(robot),
    )


def effector_facts(effector: Effector) -> RobotEffector:
    """An effector of the contract."""
    x, y, z = (float(value) for value in effector.T_frame_contact.position_m)
    qw, qx, qy, qz = (float(value) for value in effector.T_frame_contact.wxyz)
    return RobotEffector(
        name=effector.name,
        frame=effector.frame,
        kind=effector.kind,
        position_m=(x, y, z),
        orientation_wxyz=(qw, qx, qy, qz),
        contact_half_size_m=effector.contact_half_size_m,
    )


def joint_limits(robot: Robot, index: int) -> JointLimits:
    """Limits of the actuated joint ``index`` of ``Robot.joint_names``."""
    model, joint = robot.model, robot.joint_names[index]
    return JointLimits(
        joint=joint,
        group=robot.group[joint],
        lower_rad=float(model.lowerPositionLimit[7 + index]),
        upper_rad=float(model.upperPositionLimit[7 + index]),
        velocity_rad_s=float(model.velocityLimit[6 + index]),
        torque_nm=float(model.effortLimit[6 + index]),
    )


def learned_cards(robot_name: str) -> list[ReachabilityCard]:
    """Reachability cards of a robot, by measure; empty without learned reachability.

    Raises ``UnreadableFile`` (``reachability-damaged``).
    """
    cards = []
    for measure in get_args(Measure):
        try:
            cards.append(load_card(robot_name, measure))
        except NotFound:
            continue
    return cards


def proxy_card(card: ReachabilityCard, effector: str) -> ProxyCard:
    """Settings and quality of the learned density of one effector."""
    learned = card.effectors[effector]
    return ProxyCard.from_object(
        learned,
        effector=effector,
        sizes=[ProxySize.from_object(size) for size in learned.sizes],
        **{name: getattr(card, name) for name in CARD_FIELDS},
    )
