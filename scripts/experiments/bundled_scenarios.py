"""Builders of the bundled scenarios, by the stem of their files."""

from collections.abc import Callable, Mapping
from typing import Final

from experiments.building_codes import house_stairs, outdoor_stairs
from experiments.obstacles import stepping_stones, wall_step
from stridelab.contacts.scenarios.hand_scenes import stand_up
from stridelab.contacts.scenarios.parts import HRP2, Scenario
from stridelab.contacts.scenarios.stairs import (
    HandRail,
    Stairs,
    descent,
    flat_walk,
    long_stride,
    six_stairs,
    stairs_with_rail,
)


def hrp2_stairs_with_rail() -> Scenario:
    """Experiment 3 for HRP-2, with a rail at hand height and the toe gap of 62.5 mm that its shins need."""
    rail = HandRail(ahead_m=0.20, height_m=0.60, y_m=-0.45)
    return stairs_with_rail(Stairs(4, 0.15, toe_gap_m=0.0625), rail, walker=HRP2) | {
        "name": "Stairs with a rail, HRP-2"
    }


def hrp2_stepping_stones() -> Scenario:
    """Stepping stones tilted by up to 15 degrees: at 16 the stance ankle of HRP-2 reaches its joint limit.

    They are 0.27 m apart; the toes would collide with closer ones.
    """
    tilts = ((10.0, 0.0), (0.0, -12.0), (-15.0, 0.0), (0.0, 12.0))
    return stepping_stones(tilts, walker=HRP2) | {"name": "Stepping stones, HRP-2"}


def hrp2_wall_step() -> Scenario:
    """The wall step with a hand position that HRP-2 reaches with its fingertip: farther out, lower, less far ahead."""
    return wall_step(hand_m=(0.10, -0.75, 0.85), walker=HRP2) | {"name": "A step along a wall, HRP-2"}


BUNDLED: Final[Mapping[str, Callable[[], Scenario]]] = {
    "flat-walk": flat_walk,
    "long-stride": long_stride,
    "six-stairs": six_stairs,
    "stairs-with-rail": stairs_with_rail,
    "stairs-with-rail-hrp2": hrp2_stairs_with_rail,
    "stairs-down": descent,
    "stepping-stones": stepping_stones,
    "stepping-stones-hrp2": hrp2_stepping_stones,
    "wall-step": wall_step,
    "wall-step-hrp2": hrp2_wall_step,
    "stand-up": stand_up,
    "house-stairs": house_stairs,
    "outdoor-stairs": outdoor_stairs,
}
"""Builder of every file of ``models/scenarios``, by the file's stem."""
