"""The parts of a plan while it is computed: frames of the body and of its replay, checks of the certificate."""

import time
from typing import Final

import numpy as np
from jaxtyping import Float

from stridelab.contacts.sequence import ContactSequence
from stridelab.conventions import Series
from stridelab.pipelines.plan_motion import PlanWatcher
from stridelab.robots.robot import Robot
from stridelab.robots.visuals import link_names, link_pose_frames
from stridelab.schemas.plans import CertificateCheck, CertificateSummary
from stridelab.schemas.previews import LinkPoses, PartialCertificate, PartialMotion, PartialPlan, PartialReplay
from stridelab.service.kinds.partial_results import PartialWriter
from stridelab.wholebody.motion import WholeBodyMotion

FRAMES_HZ: Final = 25.0
MIN_INTERVAL_S: Final = 0.2
"""Time between two parts with frames."""
_DECIMALS: Final = 4


class PartialPlanWriter(PlanWatcher):
    """Writes what it receives as parts."""

    def __init__(self, writer: PartialWriter, robot: Robot | None = None) -> None:
        self._writer = writer
        self._robot = robot
        self._run = 0
        self._motion = _FrameBuffer()
        self._replay = _FrameBuffer()

    def on_plan(self, robot: Robot, sequence: ContactSequence) -> None:
        """Write the names of the links and the ends of the phases."""
        self._robot = robot
        ends_s = [round(float(end), 6) for end in sequence.ends_s]
        links = list(link_names(robot))
        part = PartialPlan(robot=robot.name, links=links, duration_s=sequence.duration_s, phase_ends_s=ends_s)
        self._writer.write(part)

    def on_pass(self, robot: Robot, motion: WholeBodyMotion) -> None:
        """Begin a new run of the body."""
        self._flush_motion()
        self._run += 1
        self._motion = _FrameBuffer()

    def on_samples(self, time_s: Series, q: Float[np.ndarray, "k nq"]) -> None:
        """Write frames of the body, a few at a time."""
        if self._writer.is_open:
            self._motion.add_samples(self._robot, time_s, q)
            if self._motion.is_due:
                self._flush_motion()

    def on_check(self, check: CertificateCheck) -> None:
        """Write the check."""
        self._flush_motion()
        self._writer.write(PartialCertificate(checks=[check]))

    def on_certificate(self, certificate: CertificateSummary) -> None:
        """Write whether all checks passed."""
        self._writer.write(PartialCertificate(checks=[], passed=certificate.passed))

    def on_replay_samples(self, time_s: Series, q: Float[np.ndarray, "k nq"]) -> None:
        """Write frames of the replay, a few at a time."""
        if self._writer.is_open:
            self._replay.add_samples(self._robot, time_s, q)
            if self._replay.is_due:
                self.flush_replay()

    def flush_replay(self) -> None:
        """Write the frames of the replay that are left."""
        times_s, poses = self._replay.take()
        if times_s:
            self._writer.write(PartialReplay(time_s=times_s, poses=poses))

    def _flush_motion(self) -> None:
        times_s, poses = self._motion.take()
        if times_s:
            self._writer.write(PartialMotion(run=self._run, time_s=times_s, poses=poses))


class _FrameBuffer:
    """Frames at ``FRAMES_HZ`` of a motion whose samples arrive in order."""

    def __init__(self) -> None:
        self._times_s: list[float] = []
        self._poses: list[LinkPoses] = []
        self._next_s = 0.0
        self._taken_at = -np.inf

    @property
    def is_due(self) -> bool:
        """Whether there are frames and the last ones were taken long enough ago."""
        return bool(self._times_s) and time.monotonic() - self._taken_at >= MIN_INTERVAL_S

    def add_samples(self, robot: Robot | None, time_s: Series, q: Float[np.ndarray, "k nq"]) -> None:
        """Add the samples that are due."""
        assert robot is not None
        due = []
        for k, t in enumerate(time_s.tolist()):
            if t < self._next_s - 1e-9:
                continue
            self._next_s = max(self._next_s + 1.0 / FRAMES_HZ, t)
            self._times_s.append(round(t, 4))
            due.append(k)
        for frame in np.round(link_pose_frames(robot, q[due]), _DECIMALS).tolist():
            self._poses.append([tuple(pose) for pose in frame])

    def take(self) -> tuple[list[float], list[LinkPoses]]:
        """Return the frames and forget them."""
        taken = self._times_s, self._poses
        self._times_s, self._poses, self._taken_at = [], [], time.monotonic()
        return taken
