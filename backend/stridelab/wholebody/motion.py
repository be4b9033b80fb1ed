"""The whole-body motion of the task hierarchy, and the error for a plan that the body cannot follow to its end."""

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
