"""Joint position control of a replay: its gains, and the stabiliser and the recovery that correct it."""

from dataclasses import dataclass, field
from typing import Final

import numpy as np
import pinocchio as pin
from jaxtyping import Float

from stridelab.conventions import GRAVITY_M_S2
from stridelab.robots.robot import Robot
from stridelab.wholebody.recovery.recovery import Recovery
from stridelab.wholebody.replay.stabiliser import Stabiliser

FULL_SIZE_NM: Final = 776.0
"""Weight times CoM height of TALOS, from which a robot gets the full stiffness."""


@dataclass(frozen=True)
class ReplayControl:
    """Joint control of stiffness (N m/rad) and damping (N m s/rad) in legs and torso, ``arm_share`` of it in the arms.

    A rotor inertia of 0.1 kg m^2 and 3000 N m/rad give 28 Hz, well above the motion and well below the 1 kHz steps. For
    robots with ``m g h`` below ``FULL_SIZE_NM`` the stiffness is reduced proportionally. The damping of a joint is
    limited to ``I / dt``, which stops it within one step; ``I`` is its inertia with all other joints free. Beyond twice
    that value the control is unstable. Where the stabiliser cannot undo a push, ``recovery`` leaves the plan and steps;
    it needs a stabiliser.
    """

    stiffness: float = 3000.0
    damping: float = 100.0
    arm_share: float = 0.1
    stabiliser: Stabiliser | None = field(default_factory=Stabiliser)
    recovery: Recovery | None = field(default_factory=Recovery)

    def joint_gains(self, robot: Robot, timestep_s: float) -> tuple[Float[np.ndarray, "na"], Float[np.ndarray, "na"]]:
        """Stiffness (N m/rad) and damping (N m s/rad) of every joint, for steps of ``timestep_s``."""
        joints, data = robot.joint_names, robot.model.createData()
        share = np.array([self.arm_share if robot.group[joint] in ("arm", "head") else 1.0 for joint in joints])
        ankles = {joint for effector in robot.effectors.values() for joint in effector.ankle or ()}
        ankle_share = self.stabiliser.ankle_stiffness if self.stabiliser is not None else 1.0
        ankle = np.array([ankle_share if joint in ankles else 1.0 for joint in joints])
        height_m = pin.centerOfMass(robot.model, data, robot.q_reference)[2]  # the soles are on z = 0
        size = min(1.0, robot.mass_kg * GRAVITY_M_S2 * height_m / FULL_SIZE_NM)
        pin.crba(robot.model, data, robot.q_reference)
        M = np.triu(data.M) + np.triu(data.M, 1).T
        inertia = 1.0 / np.diag(np.linalg.inv(M))[6:]
        kp = self.stiffness * size * share * ankle
        return kp, np.minimum(self.damping * size * share * np.sqrt(ankle), inertia / timestep_s)
