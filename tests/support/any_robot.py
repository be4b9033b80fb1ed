"""A walk on level ground for any robot: what of a scenario depends on the robot comes from its reference posture."""

from collections.abc import Mapping
from copy import deepcopy
from typing import Any

import numpy as np
import pinocchio as pin

from stridelab.contacts.scenario_parts import Timing
from stridelab.contacts.stairs import flat_walk
from stridelab.reachability.mixture import Mixture
from stridelab.reachability.proxy import Proxy
from stridelab.robots.contact_frames import with_contact_frames
from stridelab.robots.robot import Robot


def com_height_m(robot: Robot) -> float:
    """Of the CoM above the soles, in the reference posture."""
    return float(pin.centerOfMass(robot.model, robot.model.createData(), robot.q_reference)[2])


def walk_of(robot: Robot, steps: int, step_m: float, timing: Timing) -> dict[str, Any]:
    """``stairs.flat_walk`` with the feet as far apart as ``robot`` has them."""
    model, index = with_contact_frames(robot)
    data = model.createData()
    pin.framesForwardKinematics(model, data, robot.q_reference)
    scenario = deepcopy(flat_walk(steps, step_m, timing))
    scenario["robot"] = robot.name
    for phase in scenario["phases"]:
        for contact in phase["contacts"]:
            contact["position_m"][1] = float(data.oMf[index[contact["effector"]]].translation[1])
    return scenario


def one_normal(robot: Robot) -> Mapping[str, Proxy]:
    """One wide normal density per foot, about where the CoM is in the reference posture, in place of learned ones."""
    h = com_height_m(robot)
    covariance = np.diag([0.23 * h, 0.17 * h, 0.12 * h]) ** 2
    mean = np.array([[0.0, 0.0, 0.95 * h]])
    return {name: Proxy(Mixture(np.ones(1), mean, covariance[None])) for name in ("left_foot", "right_foot")}
