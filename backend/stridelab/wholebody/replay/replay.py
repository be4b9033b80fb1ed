"""Physics replay of a motion: joint position control, feed-forward torques and the stabiliser.

The simulation receives the plan only through the joint commands. Torques are clipped at the robot's limits. The
stabiliser's input comes from ``observe``, by default the sensed state; a caller may pass a state estimator.
"""

import time
from dataclasses import dataclass, field
from typing import Final

import numpy as np
import pinocchio as pin
from jaxtyping import Float

from stridelab.contacts.sequence import ContactSequence
from stridelab.conventions import GRAVITY_M_S2, Progress
from stridelab.robots.robot import Robot
from stridelab.wholebody.motion import WholeBodyMotion
from stridelab.wholebody.recovery.recovery import Recovery
from stridelab.wholebody.replay.disturbances import UNDISTURBED, Disturbances
from stridelab.wholebody.replay.log import Replay
from stridelab.wholebody.replay.sensors import StateObserver, as_sensed
from stridelab.wholebody.replay.stabiliser import Stabiliser
from stridelab.wholebody.replay.stepper import ReplayStepper

__all__ = ["PhysicsReplay", "Replay", "replay_with_defaults"]

PROGRESS_INTERVAL: Final = 100
FULL_SIZE_NM: Final = 776.0
"""Weight times CoM height of TALOS, from which a robot gets the full stiffness."""


@dataclass(frozen=True)
class PhysicsReplay:
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

    def run(
        self,
        robot: Robot,
        sequence: ContactSequence,
        motion: WholeBodyMotion,
        progress: Progress,
        observe: StateObserver = as_sensed,
        disturbances: Disturbances = UNDISTURBED,
    ) -> Replay:
        """Replay ``motion`` with the given disturbances and hold its last posture.

        Raises ``InvalidInput``: ``replay-rate`` for a rate that the simulator's time step does not divide,
        ``link-not-found`` for a push on a link that the robot lacks.
        """
        started = time.perf_counter()
        stepper = ReplayStepper(self, robot, sequence, motion, observe, disturbances)
        while not stepper.has_ended:
            i = stepper.advance()
            if i % PROGRESS_INTERVAL == 0:
                progress(i / len(motion.time_s), f"replay: {motion.time_s[i]:.1f} of {motion.time_s[-1]:.1f} s")
        return stepper.to_replay(time.perf_counter() - started)

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


def replay_with_defaults(
    robot: Robot, sequence: ContactSequence, motion: WholeBodyMotion, progress: Progress
) -> Replay:
    """``PhysicsReplay`` with its defaults."""
    return PhysicsReplay().run(robot, sequence, motion, progress)
