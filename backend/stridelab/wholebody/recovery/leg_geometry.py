"""Lengths of a biped that bound its steps, from the reference posture."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from jaxtyping import Float

from stridelab.conventions import Vector3
from stridelab.robots.robot import Robot


@dataclass(frozen=True, eq=False)
class LegGeometry:
    """``side`` is 1 for a left sole and -1 for a right one.

    ``leg_m`` is the length of a straight leg from hip to ankle, ``ankle_m`` the height of the ankle above the sole,
    ``com_height_m`` that of the CoM, ``hip_m`` the hip relative to the CoM. ``spacing_m`` is the distance of the
    soles' centres in the reference posture, ``half_m`` the half edges of a sole.
    """

    side: Mapping[str, float]
    leg_m: float
    ankle_m: float
    com_height_m: float
    hip_m: Mapping[str, Vector3]
    spacing_m: float
    half_m: Float[np.ndarray, "2"]

    @staticmethod
    def of_robot(robot: Robot) -> "LegGeometry | None":
        """None for a robot without exactly two soles on legs."""
        soles = [name for name, effector in robot.effectors.items() if effector.contact_half_size_m is not None]
        if len(soles) != 2:
            return None
        model, data = robot.model, robot.model.createData()
        pin.framesForwardKinematics(model, data, robot.q_reference)
        com_m = np.asarray(pin.centerOfMass(model, data, robot.q_reference)).copy()
        side: dict[str, float] = {}
        hip_m: dict[str, Vector3] = {}
        at_m: dict[str, Vector3] = {}
        legs_m: list[float] = []
        ankles_m: list[float] = []
        for name in soles:
            effector = robot.effectors[name]
            frame = model.frames[model.getFrameId(effector.frame)]
            chain = [j for j in model.supports[frame.parentJoint] if robot.group.get(model.names[j]) == "leg"]
            if len(chain) < 3:
                return None
            hip, ankle = (data.oMi[j].translation.copy() for j in (chain[0], chain[-1]))
            legs_m.append(_longest_leg_m(robot, chain))
            T = data.oMf[model.getFrameId(effector.frame)]
            at_m[name] = T.act(effector.T_frame_contact.position_m)
            side[name] = 1.0 if at_m[name][1] > 0.0 else -1.0
            hip_m[name] = hip - com_m
            ankles_m.append(float(ankle[2]))
        first, second = soles
        return LegGeometry(
            side=side,
            leg_m=min(legs_m),
            ankle_m=max(ankles_m),
            com_height_m=float(com_m[2]),
            hip_m=hip_m,
            spacing_m=abs(float(at_m[first][1] - at_m[second][1])),
            half_m=np.array(robot.effectors[first].contact_half_size_m),
        )


def _longest_leg_m(robot: Robot, chain: list[int]) -> float:
    """Largest distance from the first joint of ``chain`` to the last while one joint moves through its range."""
    model, data = robot.model, robot.model.createData()
    longest_m = 0.0
    for joint in chain[1:-1]:
        k = model.joints[joint].idx_q
        for angle_rad in np.linspace(model.lowerPositionLimit[k], model.upperPositionLimit[k], 100):
            q = robot.q_reference.copy()
            q[k] = angle_rad
            pin.forwardKinematics(model, data, q)
            leg = data.oMi[chain[-1]].translation - data.oMi[chain[0]].translation
            longest_m = max(longest_m, float(np.linalg.norm(leg)))
    return longest_m
