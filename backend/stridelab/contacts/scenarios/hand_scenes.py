"""Standing up with a hand on a rail, and where the hand of another robot goes."""

from dataclasses import dataclass
from typing import Final

from stridelab.contacts.scenarios.parts import (
    TALOS,
    Point,
    Scenario,
    Walker,
    both_feet,
    contact,
    ground,
    phase,
    round_values,
    scenario,
)

RAIL_RADIUS_M: Final = 0.02
RAIL_HAND_M: Final[Point] = (0.25, -0.50, 0.72)
CROUCH_M: Final = 0.62
"""Height of the CoM of TALOS above its soles before it stands up."""


@dataclass(frozen=True)
class ArmReach:
    """Right shoulder in the reference posture, from the middle between the soles on the ground; length of the arm."""

    shoulder_m: Point
    length_m: float

    def place_hand_m(self, talos_m: Point) -> Point:
        """The place that a hand of TALOS has at ``talos_m``: as far from the shoulder for the length of the arm."""
        share = self.length_m / TALOS_ARM.length_m
        pairs = zip(self.shoulder_m, talos_m, TALOS_ARM.shoulder_m, strict=True)
        x, y, z = (round(own + share * (place - shoulder), 3) for own, place, shoulder in pairs)
        return x, y, z


TALOS_ARM: Final = ArmReach((-0.019, -0.291, 1.370), 0.741)
"""The arm for which the scenes were made."""


def stand_up(
    start_com_height_m: float = CROUCH_M,
    hand_m: Point = RAIL_HAND_M,
    duration_s: float = 5.0,
    walker: Walker = TALOS,
    friction: float = 0.6,
) -> Scenario:
    """From a crouch to standing, both feet on the ground, the right hand at ``hand_m`` on a level rail along x."""
    x, y, z = hand_m
    rail = {
        "name": "rail",
        "kind": "rail",
        "from_m": round_values((x - 0.5, y, z - RAIL_RADIUS_M)),
        "to_m": round_values((x + 0.5, y, z - RAIL_RADIUS_M)),
        "radius_m": RAIL_RADIUS_M,
        "friction": friction,
    }
    standing = both_feet(walker, 0.0, 0.0) | {"right_hand": contact("right_hand", hand_m)}
    standing_up = scenario(
        "Standing up",
        "From a crouch to standing, the right hand on a rail.",
        walker.robot,
        [ground(), rail],
        [phase(duration_s, standing)],
    )
    return standing_up | {"start_com_height_m": start_com_height_m}
