"""Dimensions that scale scenes to a robot, from its model."""

from typing import Final

import numpy as np

from stridelab.errors import InvalidInput
from stridelab.robots.robot import Robot
from stridelab.schemas.robots import WalkerFacts
from stridelab.simulation.robot.anatomy import RobotAnatomy
from stridelab.wholebody.recovery.leg_geometry import LegGeometry
from stridelab.wholebody.shoe_check import largest_shoe_m

ARM_JOINTS: Final = 4
"""Joints of an arm whose fourth is the elbow."""


def walker_facts(robot: Robot) -> WalkerFacts | None:
    """Dimensions of a robot on the soles ``left_foot`` and ``right_foot``; None for another robot."""
    legs = LegGeometry.of_robot(robot)
    if legs is None or legs.side.keys() != {"left_foot", "right_foot"}:
        return None
    toe_m, heel_m = largest_shoe_m(robot)
    leg_m, foot_y_m = round(legs.leg_m + legs.ankle_m, 4), round(0.5 * legs.spacing_m, 4)
    shoulder_m, arm_m = _right_arm(robot)
    return WalkerFacts(leg_m=leg_m, foot_y_m=foot_y_m, toe_m=toe_m, heel_m=heel_m, shoulder_m=shoulder_m, arm_m=arm_m)


def _right_arm(robot: Robot) -> tuple[tuple[float, float, float] | None, float | None]:
    """Shoulder in the reference posture, and length of the arm over the elbow; None for a robot without such arms."""
    try:
        anatomy = RobotAnatomy.of_robot(robot)
    except InvalidInput:
        return None, None
    chain = anatomy.arm["right"]
    if len(chain) < ARM_JOINTS:
        return None, None
    shoulder, elbow = anatomy.centre_m(chain[1:3]), anatomy.origin_m(chain[3])
    hand = anatomy.effector_m("right_hand", np.zeros(3))
    x, y, z = (round(float(value), 4) for value in shoulder)
    return (x, y, z), round(float(np.linalg.norm(elbow - shoulder) + np.linalg.norm(hand - elbow)), 4)
