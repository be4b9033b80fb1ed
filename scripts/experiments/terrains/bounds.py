"""Bounds from which the survey draws its scenarios, for each robot."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from experiments.execution import G1
from stridelab.contacts.scenarios.parts import HRP2, TALOS, Walker

Range = tuple[float, float]


@dataclass(frozen=True)
class Bounds:
    """Ranges of one robot; every value of a scenario is drawn uniformly from its range.

    ``half_size_m`` is the half length and half width of the sole's rectangle. A rail's hand contact lies
    ``rail_ahead_m`` before the feet, ``rail_height_m`` above the line through the footholds and ``rail_aside_m`` from
    the middle. ``quick_s`` and ``quick_rest_s`` are the durations of swings and double supports of quick walks,
    ``level_s`` and ``careful_s`` those of swings on level ground and on uneven terrain.
    """

    walker: Walker
    half_size_m: tuple[float, float]
    step_m: Range
    arc_deg: Range
    turn_deg: Range
    side_m: Range
    slope_deg: Range
    stair_height_m: Range
    alternate_height_m: Range
    stair_depth_m: Range
    stair_gap_m: Range
    tilt_deg: Range
    beam_width_m: Range
    bar_height_m: Range
    bar_depth_m: Range
    rail_ahead_m: Range
    rail_height_m: Range
    rail_aside_m: Range
    quick_step_m: Range
    quick_s: Range
    quick_rest_s: Range
    level_s: Range = (0.9, 1.2)
    careful_s: Range = (1.3, 1.8)
    rest_s: Range = (0.2, 0.4)


BOUNDS: Final[Mapping[str, Bounds]] = {
    "talos": Bounds(
        walker=TALOS,
        half_size_m=(0.10, 0.06),
        step_m=(0.15, 0.30),
        arc_deg=(3.0, 12.0),
        turn_deg=(12.0, 24.0),
        side_m=(0.08, 0.18),
        slope_deg=(-12.0, 12.0),
        stair_height_m=(0.08, 0.17),
        alternate_height_m=(0.08, 0.17),
        stair_depth_m=(0.28, 0.33),
        stair_gap_m=(0.045, 0.06),
        tilt_deg=(4.0, 15.0),
        beam_width_m=(0.20, 0.30),
        bar_height_m=(0.05, 0.15),
        bar_depth_m=(0.04, 0.08),
        rail_ahead_m=(0.10, 0.30),
        rail_height_m=(0.70, 0.95),
        rail_aside_m=(0.45, 0.58),
        quick_step_m=(0.15, 0.30),
        quick_s=(0.5, 0.8),
        quick_rest_s=(0.1, 0.2),
    ),
    "hrp2": Bounds(
        walker=HRP2,
        half_size_m=(0.11, 0.065),
        step_m=(0.15, 0.28),
        arc_deg=(3.0, 12.0),
        turn_deg=(12.0, 24.0),
        side_m=(0.08, 0.16),
        slope_deg=(-10.0, 10.0),
        stair_height_m=(0.06, 0.15),
        alternate_height_m=(0.06, 0.12),
        stair_depth_m=(0.30, 0.34),
        stair_gap_m=(0.05, 0.0625),
        tilt_deg=(4.0, 12.0),
        beam_width_m=(0.22, 0.32),
        bar_height_m=(0.04, 0.10),
        bar_depth_m=(0.04, 0.08),
        rail_ahead_m=(0.15, 0.25),
        rail_height_m=(0.58, 0.68),
        rail_aside_m=(0.43, 0.48),
        quick_step_m=(0.12, 0.25),
        quick_s=(0.5, 0.8),
        quick_rest_s=(0.1, 0.2),
    ),
    "g1": Bounds(
        walker=G1,
        half_size_m=(0.085, 0.025),
        step_m=(0.08, 0.20),
        arc_deg=(3.0, 10.0),
        turn_deg=(10.0, 25.0),
        side_m=(0.05, 0.12),
        slope_deg=(-8.0, 8.0),
        stair_height_m=(0.04, 0.10),
        alternate_height_m=(0.04, 0.08),
        stair_depth_m=(0.26, 0.32),
        stair_gap_m=(0.04, 0.055),
        tilt_deg=(3.0, 10.0),
        beam_width_m=(0.16, 0.28),
        bar_height_m=(0.03, 0.08),
        bar_depth_m=(0.04, 0.06),
        rail_ahead_m=(0.18, 0.26),
        rail_height_m=(0.70, 0.80),
        rail_aside_m=(0.29, 0.35),
        quick_step_m=(0.08, 0.20),
        quick_s=(0.5, 0.8),
        quick_rest_s=(0.1, 0.2),
    ),
}
"""Ranges by robot; a range of heights or slopes is what its legs reach with bent knees, not the best that was seen."""
