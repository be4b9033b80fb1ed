"""The whole-body motion of the task hierarchy, and the error for a plan that the body cannot follow to its end.

A motion can be used while it is computed: its arrays are in memory that two processes share (``shared_zeros``), and
``MotionArrival`` waits for the samples that are not there yet.
"""

import math
import mmap
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float

from stridelab.contacts.sequence import ContactSequence
from stridelab.errors import Fault, NotEstimable


@dataclass(frozen=True)
class SolverFailure:
    """A sample at which a quadratic program of the hierarchy had no solution."""

    time_s: float
    phase: int
    level: int
    reason: str


@dataclass(frozen=True, eq=False)
class WholeBodyMotion:
    """``n`` samples at ``rate_hz`` in pinocchio's order of coordinates.

    ``q`` ``(n, nq)``, ``v`` and ``a`` ``(n, nv)``, ``tau_nm`` ``(n, nv - 6)``; ``forces_n`` per effector the
    world-frame force on each contact point ``(n, k, 3)``, zero without contact, acting at ``points_m``
    ``(k, 3)`` of the contact frame. ``com_m`` and ``l_nms`` are those of ``q, v``; the references those of the plan.
    With ``arrival``, samples that have not arrived are zero.
    """

    sequence: ContactSequence
    rate_hz: float
    time_s: Float[np.ndarray, "n"]
    q: Float[np.ndarray, "n nq"]
    v: Float[np.ndarray, "n nv"]
    a: Float[np.ndarray, "n nv"]
    tau_nm: Float[np.ndarray, "n na"]
    forces_n: Mapping[str, Float[np.ndarray, "n k 3"]]
    points_m: Mapping[str, Float[np.ndarray, "k 3"]]
    com_m: Float[np.ndarray, "n 3"]
    com_v_m_s: Float[np.ndarray, "n 3"]
    l_nms: Float[np.ndarray, "n 3"]
    com_reference_m: Float[np.ndarray, "n 3"]
    com_v_reference_m_s: Float[np.ndarray, "n 3"]
    l_reference_nms: Float[np.ndarray, "n 3"]
    failures: tuple[SolverFailure, ...]
    solve_time_s: float
    arrival: "MotionArrival | None" = None


class MotionArrival:
    """The arrival of a motion of ``total`` samples that another process computes; ``arrived`` are there.

    ``receive`` waits for news and returns the number of samples then. ``waited_s`` is the time spent so.
    """

    def __init__(self, total: int, arrived: int, receive: Callable[[], int]) -> None:
        self.total, self.arrived, self.waited_s = total, arrived, 0.0
        self._receive = receive

    @property
    def is_complete(self) -> bool:
        """Whether all samples are there."""
        return self.arrived >= self.total

    def wait_for_samples(self, number: int) -> None:
        """Wait until the first ``number`` samples, or all of them, are there."""
        if self.arrived >= min(number, self.total):
            return
        started = time.perf_counter()
        while self.arrived < min(number, self.total):
            self.arrived = self._receive()
        self.waited_s += time.perf_counter() - started


def shared_zeros(shape: tuple[int, ...]) -> Float[np.ndarray, "..."]:
    """Zeros in memory that processes forked from this one share with it."""
    memory = mmap.mmap(-1, max(1, 8 * math.prod(shape)))
    return np.frombuffer(memory, dtype=float, count=math.prod(shape)).reshape(shape)


MotionWatcher = Callable[[Float[np.ndarray, "k"], Float[np.ndarray, "k nq"]], None]
"""Receives times (s) and postures of the samples of a run, each once and in order."""
LEVELS: Final = ("dynamics, contacts and bounds", "centre of mass and moving effectors", "momentum, posture and forces")
"""Descriptions of the hierarchy's levels, by number."""


class WholeBodyStopped(NotEstimable):
    """``whole-body-failed``: the hierarchy ended in ``phase``.

    ``level`` of ``LEVELS`` is the first violated one, ``names`` are the exhausted limits of joints or effectors, the
    worst first. ``motion`` ends at ``time_s``, the last sample before the failure.
    """

    def __init__(
        self,
        message: str,
        faults: Sequence[Fault],
        motion: WholeBodyMotion,
        phase: int,
        level: int,
        names: Sequence[str],
    ) -> None:
        super().__init__("whole-body-failed", message, faults)
        self.motion, self.phase, self.level, self.names = motion, phase, level, tuple(names)

    @property
    def time_s(self) -> float:
        """Time (s) of the last sample of the motion."""
        return float(self.motion.time_s[-1])
