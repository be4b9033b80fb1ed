"""Conditions of a completed replay: the robot does not fall and follows the plan within limits.

Each violated condition is reported with its value, so that its severity is visible.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

SLIP_M: Final = 0.020
"""Largest displacement of a loaded sole."""
TORQUE_RATIO: Final = 1.2
"""Largest commanded torque as a multiple of its limit, at which the applied torque is clipped."""
HAND_SHARE: Final = 0.95
"""Share of its planned contact time in which a hand has to be loaded at its planned position."""
_LISTED: Final = 4


@dataclass(frozen=True)
class Collision:
    """An unplanned contact of two links, or of a link or an effector with a surface.

    ``time_s`` is its first occurrence, ``force_max_n`` the largest force.
    """

    first: str
    second: str
    time_s: float
    force_max_n: float


@dataclass(frozen=True)
class MissedCondition:
    """One violated condition: a stable code and a sentence with the value."""

    code: str
    message: str


def missed_conditions(
    *,
    fall_time_s: float | None,
    collided: Sequence[Collision],
    slip_max_m: float,
    torque_ratio_max: float,
    hand_in_place_shares: Mapping[str, float],
) -> tuple[MissedCondition, ...]:
    """Violated conditions of a completed replay, a fall first."""
    violated: list[MissedCondition] = []
    if fall_time_s is not None:
        violated.append(MissedCondition("replay-fell", f"The robot falls after {fall_time_s:.1f} s."))
    if collided:
        violated.append(MissedCondition("replay-collided", _describe_collisions(collided)))
    if slip_max_m > SLIP_M:
        message = f"A loaded foot slips by {1e3 * slip_max_m:.0f} mm; at most {1e3 * SLIP_M:.0f} mm are allowed."
        violated.append(MissedCondition("replay-slipped", message))
    if torque_ratio_max > TORQUE_RATIO:
        message = f"A joint torque command reaches {torque_ratio_max:.1f} times its limit; {TORQUE_RATIO:g} is allowed."
        violated.append(MissedCondition("replay-torque", message))
    for hand, share in hand_in_place_shares.items():
        if share < HAND_SHARE:
            message = f"{hand} is in place for {share:.0%} of its contact; {HAND_SHARE:.0%} is required."
            violated.append(MissedCondition("replay-hand-off", message))
    return tuple(violated)


def _describe_collisions(collided: Sequence[Collision]) -> str:
    listed = "; ".join(
        f"{one.first} and {one.second} from {one.time_s:.2f} s, {one.force_max_n:.0f} N at most"
        for one in collided[:_LISTED]
    )
    more = f"; and {len(collided) - _LISTED} more" if len(collided) > _LISTED else ""
    pairs = "1 pair touches" if len(collided) == 1 else f"{len(collided)} pairs touch"
    return f"{pairs} without being planned to: {listed}{more}."
