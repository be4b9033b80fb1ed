"""Resumption of a plan after a recovery: the new motion, and the blend of the joint commands into its first posture.

The recovery ends at rest on two soles, anywhere. A new motion begins there and ends where the plan ends. Its first
posture has the same soles and about the same CoM, but not the same joint angles, so that the joint commands move from
the measured angles to it:

    q_command = q_0 + (1 - s) (q_measured - q_0) ,     s = 10 x^3 - 15 x^4 + 6 x^5 ,     x = t / T .
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from stridelab.contacts.swing import quintic_scaling
from stridelab.conventions import Angles
from stridelab.wholebody.motion import WholeBodyMotion
from stridelab.wholebody.replay.sensors import SensedState

BLEND_S: Final = 1.0
MAX_RESUMPTIONS: Final = 4
"""Resumptions in one replay; after another recovery the robot stays where it is."""


@dataclass(frozen=True, eq=False)
class Resumption:
    """A motion that reaches contacts of the plan at its own time ``own_join_s``, which is ``join_s`` of the plan."""

    motion: WholeBodyMotion
    own_join_s: float
    join_s: float

    def plan_time_s(self, own_s: float) -> float:
        """Time of the plan at a time of the motion; ``join_s`` until the motion reaches the plan's contacts."""
        return self.join_s + max(0.0, own_s - self.own_join_s)


@dataclass(frozen=True)
class NotResumed:
    """Why a plan cannot be resumed."""

    reason: str


Resume = Callable[[float, SensedState], Resumption | NotResumed]
"""Plans the rest of a motion that was left at a time of the plan (s), from a measured state at rest."""


@dataclass(eq=False)
class JointBlend:
    """Angles and torques to add to the first posture of a motion, which decrease to zero within ``BLEND_S``."""

    off_rad: Angles
    off_nm: Angles
    elapsed_s: float = 0.0

    @property
    def has_ended(self) -> bool:
        """Whether nothing is added any more."""
        return self.elapsed_s >= BLEND_S

    def advance(self, dt_s: float) -> tuple[Angles, Angles, Angles]:
        """Angles (rad), rates (rad/s) and torques (N m) of the next sample."""
        share, rate, _ = quintic_scaling(self.elapsed_s, (0.0, 1.0), BLEND_S)
        self.elapsed_s += dt_s
        return (1.0 - share) * self.off_rad, -rate * self.off_rad, (1.0 - share) * self.off_nm
