"""The stabiliser of the replay: capture-point feedback through the ankles.

The divergent component of motion ``xi = c + c' / w`` with ``w = sqrt(g / h)`` runs away from the centre of pressure.
Where it is ahead of its reference, the centre of pressure is moved ahead of it as well, by ``k (xi - xi_ref)`` within
the sole, and the shift becomes ankle torques: a force ``f_z`` shifted by ``d`` turns the foot with ``d x f``, which
the joint with axis ``a`` has to oppose by ``-a (d x f)``.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from jaxtyping import Float

from stridelab.conventions import GRAVITY_M_S2, Rotation, Vector3
from stridelab.robots.robot import Robot

LOWEST_COM_M = 0.3
"""Below this the pendulum is no model of the robot any more."""


@dataclass(frozen=True, eq=False)
class Ankle:
    """Two joints next to a sole: their indices among the actuated joints and their axes in the contact frame."""

    joints: tuple[int, int]
    axes: Float[np.ndarray, "2 3"]
    half_size_m: tuple[float, float]


@dataclass(frozen=True, eq=False)
class Standing:
    """The soles stood on, by effector with their orientation, and what stands on them."""

    soles: Mapping[str, Rotation]
    com_height_m: float
    weight_n: float


@dataclass(frozen=True)
class AnkleStabiliser:
    """``gain`` of the capture-point error; the shift stays within ``share`` of the sole's half edges.

    ``ankle_stiffness`` scales the position control of the ankles, which would otherwise fight the shift.
    """

    gain: float = 1.5
    share: float = 0.7
    ankle_stiffness: float = 0.2

    def torques_nm(
        self,
        ankles: Mapping[str, Ankle],
        standing: Standing,
        com_error_m: Vector3,
        com_v_error_m_s: Vector3,
        n_joints: int,
    ) -> Float[np.ndarray, "na"]:
        """Torques to add to the feed-forward ones of the ``n_joints`` actuated joints."""
        tau = np.zeros(n_joints)
        w = np.sqrt(GRAVITY_M_S2 / max(standing.com_height_m, LOWEST_COM_M))
        shift = self.gain * (com_error_m + com_v_error_m_s / w)
        for name, R in standing.soles.items():
            if name not in ankles:
                continue
            ankle = ankles[name]
            limit = self.share * np.array(ankle.half_size_m)
            dx, dy = np.clip((R.T @ [shift[0], shift[1], 0.0])[:2], -limit, limit)
            f_z = standing.weight_n / len(standing.soles)
            tau[list(ankle.joints)] -= ankle.axes @ [dy * f_z, -dx * f_z, 0.0]
        return tau


def ankles_of(robot: Robot) -> dict[str, Ankle]:
    """The ankles of all soles that have two joints; axes as they stand in the reference posture."""
    data = robot.model.createData()
    found = {}
    for name, effector in robot.effectors.items():
        if effector.ankle is None or effector.contact_half_size_m is None:
            continue
        frame = robot.model.getFrameId(effector.frame)
        J = pin.computeFrameJacobian(robot.model, data, robot.q_reference, frame, pin.ReferenceFrame.LOCAL)
        columns = [robot.model.joints[robot.model.getJointId(joint)].idx_v for joint in effector.ankle]
        axes = (effector.T_frame_contact.rotation.T @ J[3:, columns]).T
        first, second = (column - 6 for column in columns)
        found[name] = Ankle((first, second), np.ascontiguousarray(axes), effector.contact_half_size_m)
    return found
