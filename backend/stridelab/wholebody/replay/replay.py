"""Physics replay of a motion: joint position control, feed-forward torques and the stabiliser.

The simulation receives the plan only through the joint commands. Torques are clipped at the robot's limits. The
stabiliser's input comes from ``observe``, by default the sensed state; a caller may pass a state estimator.
"""

import time
from typing import Final

from stridelab.contacts.sequence import ContactSequence
from stridelab.conventions import Progress
from stridelab.robots.robot import Robot
from stridelab.wholebody.motion import MotionWatcher, WholeBodyMotion
from stridelab.wholebody.replay.disturbances import UNDISTURBED, Disturbances
from stridelab.wholebody.replay.log import Replay
from stridelab.wholebody.replay.replay_control import ReplayControl
from stridelab.wholebody.replay.resumption import Resume
from stridelab.wholebody.replay.sensors import StateObserver, as_sensed
from stridelab.wholebody.replay.stepper import ReplayStepper

__all__ = ["PhysicsReplay", "Replay", "replay_with_defaults"]

PROGRESS_INTERVAL: Final = 100
"""Progress and new samples are reported after this many samples."""


class PhysicsReplay(ReplayControl):
    """A replay with the joint control, stabiliser and recovery of ``ReplayControl``."""

    def run(
        self,
        robot: Robot,
        sequence: ContactSequence,
        motion: WholeBodyMotion,
        progress: Progress,
        observe: StateObserver = as_sensed,
        disturbances: Disturbances = UNDISTURBED,
        watch: MotionWatcher | None = None,
        resume: Resume | None = None,
    ) -> Replay:
        """Replay ``motion`` with the given disturbances and hold its last posture.

        A motion that is still being computed (``motion.arrival``) is followed as it arrives, with the same result.
        ``watch`` receives the samples as they are simulated. With ``resume``, a plan that was left for a recovery is
        resumed once the robot rests; no time passes in the simulation while it is planned. Without, the replay ends
        there.

        Raises ``InvalidInput``: ``replay-rate`` for a rate that the simulator's time step does not divide,
        ``link-not-found`` for a push on a link that the robot lacks.
        """
        started = time.perf_counter()
        stepper = ReplayStepper(self, robot, sequence, motion, observe, disturbances)
        watched = 0
        while not stepper.has_ended or (stepper.rests and resume is not None and stepper.resume_plan(resume)):
            i = stepper.advance()
            if i % PROGRESS_INTERVAL == 0 and stepper.motion is motion:
                progress(i / len(motion.time_s), f"replay: {motion.time_s[i]:.1f} of {motion.time_s[-1]:.1f} s")
            if watch is not None and (stepper.samples - watched >= PROGRESS_INTERVAL or stepper.has_ended):
                watch(*stepper.log.samples_from(watched))
                watched = stepper.samples
        waited_s = 0.0 if motion.arrival is None else motion.arrival.waited_s
        return stepper.to_replay(time.perf_counter() - started - waited_s)


def replay_with_defaults(
    robot: Robot, sequence: ContactSequence, motion: WholeBodyMotion, progress: Progress
) -> Replay:
    """``PhysicsReplay`` with its defaults."""
    return PhysicsReplay().run(robot, sequence, motion, progress)
