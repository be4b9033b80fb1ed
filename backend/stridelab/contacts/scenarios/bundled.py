"""The scenarios that every installation brings with it: their builders by the stems of the files."""

from collections.abc import Callable, Mapping
from typing import Final

from stridelab.contacts.scenarios.obstacles import stand_up, stepping_stones, wall_step
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
    """Experiment 3 for HRP-2, with a rail at the height of its hand; its shins need 62.5 mm before its toes."""
    rail = HandRail(ahead_m=0.20, height_m=0.60, y_m=-0.45)
    return stairs_with_rail(Stairs(4, 0.15, toe_gap_m=0.0625), rail, walker=HRP2) | {
        "name": "Stairs with a rail, HRP-2"
    }


def hrp2_stepping_stones() -> Scenario:
    """Stones that lean by 15 degrees: at 16 the ankle that carries HRP-2 comes to the end of its range.

    They lie 0.27 m apart; nearer ones are in the way of its toes.
    """
    tilts = ((10.0, 0.0), (0.0, -12.0), (-15.0, 0.0), (0.0, 12.0))
    return stepping_stones(tilts, walker=HRP2) | {"name": "Stepping stones, HRP-2"}


def hrp2_wall_step() -> Scenario:
    """The wall where HRP-2's hand meets it with its tip and not with its side: farther out, lower, less far ahead."""
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
}
"""Builder of every file of ``models/scenarios``, by the file's stem."""
