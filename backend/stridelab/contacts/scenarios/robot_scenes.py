"""The bundled scenes for any robot: lengths scaled by its legs, times by their square root.

Treads are deeper where the shoes of the robot need it. Where a hand holds depends on the arms: its place from the
shoulder is that of TALOS times the length of the arm.
"""

import math
from collections.abc import Callable, Mapping
from typing import Final

from stridelab.contacts.scenarios.hand_scenes import (
    RAIL_HAND_M,
    ArmReach,
    stand_up,
)
from stridelab.contacts.scenarios.parts import Scenario, Timing, Walker
from stridelab.contacts.scenarios.stairs import (
    CLIMBING,
    HOLDING_ON,
    STRIDING,
    STROLLING,
    TOE_GAP_M,
    HandRail,
    Stairs,
    descent,
    flat_walk,
    long_stride,
    six_stairs,
    stairs_with_rail,
)

TALOS_LEG_M: Final = 0.812
"""Length of the straight leg of TALOS, for which the scenes were made, from the hip to the sole."""
STAIR_HEIGHT_M: Final = 0.10
RAIL_STAIR_HEIGHT_M: Final = 0.15
SCALED_CROUCH_M: Final = 0.70
"""Height of the CoM from which a robot of the size of TALOS stands up; lower, the waist of HRP-2 meets its chest."""
STAIR_DEPTH_M: Final = 0.30
TREAD_MARGIN_M: Final = 0.02


def scaled_scene(scene: str, walker: Walker, leg_m: float, arm: ArmReach | None = None) -> Scenario:
    """The bundled ``scene`` for a robot whose straight legs are ``leg_m`` long, in plain form.

    ``scene`` is one of ``SCENES``, or of ``HAND_SCENES`` for a robot with an ``arm``.
    """
    scale = leg_m / TALOS_LEG_M
    if scene in SCENES or arm is None:
        scaled = SCENES[scene](walker, scale)
        scaled["description"] += f" Scaled to legs of {leg_m:.2f} m."
        return scaled
    scaled = HAND_SCENES[scene](walker, scale, arm)
    scaled["description"] += f" Scaled to legs of {leg_m:.2f} m and arms of {arm.length_m:.2f} m."
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


def _scaled_stand_up(walker: Walker, scale: float, arm: ArmReach) -> Scenario:
    duration_s = round(math.sqrt(scale) * 5.0, 2)
    return stand_up(round(scale * SCALED_CROUCH_M, 3), arm.place_hand_m(RAIL_HAND_M), duration_s, walker)


def _scaled_rail(walker: Walker, scale: float, arm: ArmReach) -> Scenario:
    usual = HandRail()
    x, y, z = arm.place_hand_m((usual.ahead_m, usual.y_m, usual.height_m))
    stairs = scaled_stairs(walker, scale, 4, round(scale * RAIL_STAIR_HEIGHT_M, 3))
    rail = HandRail(ahead_m=x, height_m=z, y_m=y)
    return stairs_with_rail(stairs, rail, scaled_timing(HOLDING_ON, scale), walker)


HAND_SCENES: Final[Mapping[str, Callable[[Walker, float, ArmReach], Scenario]]] = {
    "stairs-with-rail": _scaled_rail,
    "stand-up": _scaled_stand_up,
}
"""Builders of the scenes of the right hand, from a robot, the length of its legs over that of TALOS, and its arm."""


def scaled_stairs(walker: Walker, scale: float, number: int, height_m: float) -> Stairs:
    """Stairs as deep as those of TALOS times ``scale``, or as deep as the shoes of ``walker`` need."""
    gap_m = scale * TOE_GAP_M
    depth_m = max(scale * STAIR_DEPTH_M, walker.toe_m + gap_m + walker.heel_m + TREAD_MARGIN_M)
    return Stairs(number, height_m, round(depth_m, 3), toe_gap_m=gap_m)


def scaled_timing(timing: Timing, scale: float) -> Timing:
    """``timing`` times ``sqrt(scale)``: the same Froude number for lengths times ``scale``."""
    return Timing(*(round(math.sqrt(scale) * time_s, 2) for time_s in (timing.ends_s, timing.move_s, timing.rest_s)))
