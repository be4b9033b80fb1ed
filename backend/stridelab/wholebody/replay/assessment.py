"""When a replay is completed: the robot does not fall, and what it does is what was planned.

Each limit that is missed is named with its number, so that a reader can tell a graze from a wreck.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

SLIP_M: Final = 0.020
"""A loaded sole that is displaced by more has not stood."""
TORQUE_RATIO: Final = 1.2
"""Torques asked for may exceed their limits, at which they are cut, by a fifth."""
HAND_SHARE: Final = 0.95
"""Of its planned contact, in which a hand has to be loaded at its place."""
_LISTED: Final = 4


@dataclass(frozen=True)
class Collision:
    """Two links, or a link or an effector and a surface, that touch without being planned to.

    ``time_s`` is when they first do, ``force_max_n`` the largest force between them.
    """

    first: str
    second: str
    time_s: float
    force_max_n: float


@dataclass(frozen=True)
class Missed:
    """One condition that is not met: a stable code and a sentence with the number."""

    code: str
    message: str


def missed(
    *,
    fall_time_s: float | None,
    collided: Sequence[Collision],
    slip_max_m: float,
    torque_ratio_max: float,
    hand_in_place_shares: Mapping[str, float],
) -> tuple[Missed, ...]:
    """The conditions of a completed replay that are not met, a fall first."""
    found: list[Missed] = []
    if fall_time_s is not None:
        found.append(Missed("replay-fell", f"The robot falls after {fall_time_s:.1f} s."))
    if collided:
        found.append(Missed("replay-collided", _collisions(collided)))
    if slip_max_m > SLIP_M:
        message = f"A loaded foot slips by {1e3 * slip_max_m:.0f} mm; at most {1e3 * SLIP_M:.0f} mm are allowed."
        found.append(Missed("replay-slipped", message))
    if torque_ratio_max > TORQUE_RATIO:
        message = f"A joint is asked for {torque_ratio_max:.1f} times its torque limit; {TORQUE_RATIO:g} is allowed."
        found.append(Missed("replay-torque", message))
    for hand, share in hand_in_place_shares.items():
        if share < HAND_SHARE:
            message = f"{hand} is in place for {share:.0%} of its contact; {HAND_SHARE:.0%} is wanted."
            found.append(Missed("replay-hand-off", message))
    return tuple(found)


def _collisions(collided: Sequence[Collision]) -> str:
    listed = "; ".join(
        f"{one.first} and {one.second} from {one.time_s:.2f} s, {one.force_max_n:.0f} N at most"
        for one in collided[:_LISTED]
    )
    more = f"; and {len(collided) - _LISTED} more" if len(collided) > _LISTED else ""
    pairs = "1 pair touches" if len(collided) == 1 else f"{len(collided)} pairs touch"
    return f"{pairs} without being planned to: {listed}{more}."
