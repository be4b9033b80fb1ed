"""The planner's problem: from standing at rest on the first contacts to standing at rest on the last."""

from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache
from typing import Final

import pinocchio as pin

from stridelab.centroidal.problem import CentroidalProblem, standing_com_m
from stridelab.contacts.sequence import ContactSequence
from stridelab.reachability.proxy.effector_proxy import Proxy
from stridelab.robots.robot import Robot

COM_LOWERING_M: Final = 0.017
"""Lowering of the CoM below the reference posture, so that the knees can still extend."""
RAIL_FRICTION_SHARE: Final = 0.5
"""Share of the friction of rails that the plan uses: beside the middle of a round bar, its surface leans.

A ball of 2 cm that lands 9 mm beside the middle of a bar of 2 cm stands on a slope of 13 degrees, which leaves a
little more than half of a friction of 0.6.
"""


def from_rest_to_rest(robot: Robot, sequence: ContactSequence, proxies: Mapping[str, Proxy]) -> CentroidalProblem:
    """Problem of ``sequence`` with the CoM above the mean of the soles at both ends.

    The start height is that of the scenario, if given.

    Raises ``InvalidInput`` as ``CentroidalProblem`` and ``standing_com_m`` do.
    """
    height_m = standing_height_m(robot)
    starts_m = height_m if sequence.start_com_height_m is None else sequence.start_com_height_m
    start = standing_com_m(sequence.phases[0].contacts, starts_m, robot.effectors)
    end = standing_com_m(sequence.phases[-1].contacts, height_m, robot.effectors)
    problem = CentroidalProblem(sequence, robot.mass_kg, robot.effectors, proxies, start, end)
    return replace(problem, rail_friction_share=RAIL_FRICTION_SHARE)


@lru_cache(maxsize=8)
def standing_height_m(robot: Robot) -> float:
    """Height of the CoM above the soles of a robot at rest."""
    return float(pin.centerOfMass(robot.model, robot.model.createData(), robot.q_reference)[2]) - COM_LOWERING_M
