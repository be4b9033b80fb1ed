"""Joints that the balance does not control: a servo of their own moves them, as a person at a remote control would.

The torques of the servo are known, so that the accelerations of these joints follow from their rows of the equations
of motion. For the driven joints D, on which no contact acts,

    M_D a + h_D = tau_D ,    tau_D = clip(kp (q_target - q) - kd q', -tau_max, tau_max) .
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float, Int

from stridelab.conventions import Angles
from stridelab.robots.robot import Robot
from stridelab.wholebody.control.hierarchical_qp import Rows
from stridelab.wholebody.control.rigid_body import RigidBody


@dataclass(eq=False)
class DrivenJoints:
    """A servo of stiffness ``kp_nm_rad`` and damping ``kd_nms_rad`` ``(n,)`` for the joints ``names``.

    ``target_rad`` ``(n,)`` may change at any time. Raises ``ValueError`` for a joint that the robot lacks.
    """

    robot: Robot
    names: Sequence[str]
    kp_nm_rad: Float[np.ndarray, "n"]
    kd_nms_rad: Float[np.ndarray, "n"]
    target_rad: Float[np.ndarray, "n"]
    at: Int[np.ndarray, "n"] = field(init=False)
    """Indices among the actuated joints."""

    def __post_init__(self) -> None:
        self.at = np.array([self.robot.joint_names.index(name) for name in self.names], dtype=int)
        self._limit_nm = self.robot.model.effortLimit[6:][self.at]

    def torques_nm(self, q_rad: Angles, v_rad_s: Angles) -> Float[np.ndarray, "n"]:
        """Torques of the servo at angles and rates ``(na,)`` of all actuated joints."""
        tau = self.kp_nm_rad * (self.target_rad - q_rad[self.at]) - self.kd_nms_rad * v_rad_s[self.at]
        return np.asarray(np.clip(tau, -self._limit_nm, self._limit_nm))

    def motion_rows(self, body: RigidBody, nz: int) -> Rows:
        """Rows of the equations of motion for the driven joints, padded with zeros to ``nz`` unknowns."""
        A = np.zeros((len(self.at), nz))
        A[:, : body.model.nv] = body.M[6 + self.at]
        return Rows(A, self.torques_nm(body.q[7:], body.v[6:]) - body.h[6 + self.at])
