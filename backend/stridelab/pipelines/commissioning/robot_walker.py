"""Dimensions that scale scenes to a robot, from its model."""

from stridelab.robots.robot import Robot
from stridelab.schemas.robots import WalkerFacts
from stridelab.wholebody.recovery.leg_geometry import LegGeometry
from stridelab.wholebody.shoe_check import largest_shoe_m


def walker_facts(robot: Robot) -> WalkerFacts | None:
    """Dimensions of a robot on the soles ``left_foot`` and ``right_foot``; None for another robot."""
    legs = LegGeometry.of_robot(robot)
    if legs is None or legs.side.keys() != {"left_foot", "right_foot"}:
        return None
    toe_m, heel_m = largest_shoe_m(robot)
    leg_m, foot_y_m = round(legs.leg_m + legs.ankle_m, 4), round(0.5 * legs.spacing_m, 4)
    return WalkerFacts(leg_m=leg_m, foot_y_m=foot_y_m, toe_m=toe_m, heel_m=heel_m)
