"""The bundled scenes of the feet for any robot: lengths scaled by its legs, times by their square root.

Treads are deeper where the shoes of the robot need it. Scenes with hands are not scaled: where a hand can hold depends
on the arms.
"""

import math
from collections.abc import Callable, Mapping
from typing import Final

from stridelab.contacts.scenarios.parts import Scenario, Timing, Walker
from stridelab.contacts.scenarios.stairs import (
    CLIMBING,
    STRIDING,
    STROLLING,
    TOE_GAP_M,
    Stairs,
    descent,
    flat_walk,
    long_stride,
    six_stairs,
)

TALOS_LEG_M: Final = 0.812
"""Length of the straight leg of TALOS, for which the scenes were made, from the hip to the sole."""
STAIR_HEIGHT_M: Final = 0.10
STAIR_DEPTH_M: Final = 0.30
TREAD_MARGIN_M: Final = 0.02


def scaled_scene(scene: str, walker: Walker, leg_m: float) -> Scenario:
    """The bundled ``scene``, one of ``SCENES``, for a robot whose straight legs are ``leg_m`` long, in plain form."""
    scaled = SCENES[scene](walker, leg_m / TALOS_LEG_M)
    scaled["description"] += f" Scaled to legs of {leg_m:.2f} m."
    return scaled


def _scaled_walk(walker: Walker, scale: float) -> Scenario:
    return flat_walk(8, round(scale * 0.25, 3), scaled_timing(STROLLING, scale), walker)


def _scaled_strides(walker: Walker, scale: float) -> Scenario:
    return long_stride(5, round(scale * 0.45, 3), scaled_timing(STRIDING, scale), walker)


def _scaled_climb(walker: Walker, scale: float) -> Scenario:
    stairs = scaled_stairs(walker, scale, 6, round(scale * STAIR_HEIGHT_M, 3))
    return six_stairs(stairs, scaled_timing(CLIMBING, scale), walker)


def _scaled_descent(walker: Walker, scale: float) -> Scenario:
    stairs = scaled_stairs(walker, scale, 4, round(scale * STAIR_HEIGHT_M, 3))
    return descent(stairs, scaled_timing(CLIMBING, scale), walker)


SCENES: Final[Mapping[str, Callable[[Walker, float], Scenario]]] = {
    "flat-walk": _scaled_walk,
    "long-stride": _scaled_strides,
    "six-stairs": _scaled_climb,
    "stairs-down": _scaled_descent,
}
"""Builders of the scenes, from a robot and the length of its legs over that of TALOS."""


def scaled_stairs(walker: Walker, scale: float, number: int, height_m: float) -> Stairs:
    """Stairs as deep as those of TALOS times ``scale``, or as deep as the shoes of ``walker`` need."""
    gap_m = scale * TOE_GAP_M
    depth_m = max(scale * STAIR_DEPTH_M, walker.toe_m + gap_m + walker.heel_m + TREAD_MARGIN_M)
    return Stairs(number, height_m, round(depth_m, 3), toe_gap_m=gap_m)


def scaled_timing(timing: Timing, scale: float) -> Timing:
    """``timing`` times ``sqrt(scale)``: the same Froude number for lengths times ``scale``."""
    return Timing(*(round(math.sqrt(scale) * time_s, 2) for time_s in (timing.ends_s, timing.move_s, timing.rest_s)))
