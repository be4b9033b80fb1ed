"""What a step is: from the lift-off of one foot to the next lift-off of the other, single support and then double."""

from dataclasses import dataclass
from typing import Final, Literal

from stridelab.recordings.recording import Side

TimingSource = Literal["plates", "markers", "mixed"]
MOST_MISSING: Final = 0.08
"""Share of a step that may lack at either end: the search for windows calls a foot down that only may be."""


@dataclass(frozen=True, kw_only=True)
class GaitStep:
    """One step in seconds of the recording: the ``side`` swings from ``lift_off_s`` to ``strike_s``.

    Double support lasts from ``strike_s`` to ``next_lift_off_s``, where the other foot leaves the ground. ``period_s``
    is from the strike before to this strike, or from lift-off to lift-off where that strike was not seen.
    ``length_m`` is along the walk from where the heel of the standing foot is (while it is flat, as the other swings)
    to where the heel of ``side`` strikes; None where they are not seen.
    ``measured`` tells whether all contact force was on plates throughout. ``source`` is what the timing comes from.
    ``prior_strike_s`` is when the standing foot had struck; None where that was not seen.
    """

    side: Side
    lift_off_s: float
    strike_s: float
    next_lift_off_s: float
    period_s: float
    length_m: float | None
    speed_m_s: float
    measured: bool
    source: TimingSource
    prior_strike_s: float | None = None

    @property
    def start_s(self) -> float:
        """Beginning of single support."""
        return self.lift_off_s

    @property
    def end_s(self) -> float:
        """End of double support."""
        return self.next_lift_off_s

    @property
    def double_support_s(self) -> tuple[float, float]:
        """When both feet are down."""
        return (self.strike_s, self.next_lift_off_s)
