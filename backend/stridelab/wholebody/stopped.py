"""A plan that the body cannot follow to its end: what stopped it, and the motion until then."""

from collections.abc import Sequence
from typing import Final

from stridelab.errors import Fault, NotEstimable
from stridelab.wholebody.motion import WholeBodyMotion

LEVELS: Final = ("dynamics, contacts and bounds", "centre of mass and moving effectors", "momentum, posture and forces")
"""Of the hierarchy, by number."""


class WholeBodyStopped(NotEstimable):
    """``whole-body-failed``: the hierarchy ended in ``phase``.

    ``level`` of ``LEVELS`` is the first that was violated, ``names`` say which joints or effectors ran out of what, the
    worst first. ``motion`` ends at ``time_s``, the last sample before that.
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
        """Until when there is a motion."""
        return float(self.motion.time_s[-1])
