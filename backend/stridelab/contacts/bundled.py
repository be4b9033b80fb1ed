"""The scenarios that every installation brings with it: their builders by the stems of the files."""

from collections.abc import Callable, Mapping
from typing import Final

from stridelab.contacts.obstacles import stand_up, stepping_stones, wall_step
from stridelab.contacts.scenario_parts import HRP2, Scenario
from stridelab.contacts.stairs import HandRail, Stairs, descent, flat_walk, long_stride, six_stairs, stairs_with_rail


def hrp2_stairs_with_rail() -> Scenario:
    """Experiment 3 for HRP-2, with a rail at the height of its hand; its shins need 62.5 mm before its toes."""
    rail = HandRail(ahead_m=0.20, height_m=0.60, y_m=-0.45)
    return stairs_with_rail(Stairs(4, 0.15, toe_gap_m=0.0625), rail, walker=HRP2) | {
        "name": "Stairs with a rail, HRP-2"
    }


BUNDLED: Final[Mapping[str, Callable[[], Scenario]]] = {
    "flat-walk": flat_walk,
    "long-stride": long_stride,
    "six-stairs": six_stairs,
    "stairs-with-rail": stairs_with_rail,
    "stairs-with-rail-hrp2": hrp2_stairs_with_rail,
    "stairs-down": descent,
    "stepping-stones": stepping_stones,
    "wall-step": wall_step,
    "stand-up": stand_up,
}
"""Builder of every file of ``models/scenarios``, by the file's stem."""
