"""Calibration of the stated errors of measures on simulated walks, where the true values are known.

The propagated deviation of a measure of the CoM is that of the smoother's state at one instant. Most of this error is
the same throughout a stride (the segment table, the body mass, the tare of the plates) and cancels in a range, in an
excursion or in a mean; the state's covariance does not contain how it is correlated in time. So the deviation is
multiplied by the factor with which the 95 % band holds the truth in 95 % of the steps of 600 walks with seeds from 6000
to 6199 and 8000 to 8399 (``scripts/make_measures_coverage.py``), 93 to 97 %; other seeds test it. There are three: for
steps in which all force is measured, for the others, where the velocity follows from markers, and for a CoM of the
markers alone. Of the last, the sideways margins are those of people (``MARKERS_ALONE_SD``), whose skin moves, and times
are as propagated: the errors of their events are drawn as stated.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Final

from stridelab.measures.measure import Measure
from stridelab.measures.walk_motion import UP, WalkMotion
from stridelab.walking.steps import GaitStep

MEASURED_VELOCITY_SD_M_S: Final = 0.01
"""Largest deviation of the vertical velocity of a step in which all force is measured."""
FACTORS: Final[Mapping[str, tuple[float, float, float]]] = {
    "step_length": (1.05, 0.99, 0.94),
    "step_width": (1.02, 0.92, 0.88),
    "walking_speed": (0.55, 1.32, 1.42),
    "step_time": (0.42, 0.96, 1.00),
    "cadence": (0.42, 0.96, 1.00),
    "double_support_share": (0.67, 1.00, 1.00),
    "stride_time": (0.40, 1.02, 1.00),
    "stance_share": (0.89, 1.03, 1.00),
    "swing_share": (0.89, 1.03, 1.00),
    "stride_length": (1.01, 0.96, 0.63),
    "com_vertical_excursion": (0.079, 0.28, 0.42),
    "com_lateral_excursion": (0.0418, 0.21, 0.40),
    "com_speed": (0.109, 0.70, 0.24),
    "margin_of_stability_ml_min": (0.54, 0.38, 1.00),
    "margin_of_stability_ap_contact": (1.32, 0.57, 0.96),
    "margin_of_stability_ml_contact": (0.56, 0.33, 1.00),
    "capture_point_offset_ap": (1.31, 0.57, 1.03),
    "capture_point_offset_ml": (0.56, 0.33, 1.00),
    "energy_recovery": (0.164, 0.19, 3.76),
    "external_work": (0.075, 0.093, 1.00),
    "cycloid_wheel_radius": (0.38, 1.37, 2.31),
    "cycloid_point_radius": (0.24, 0.93, 1.51),
    "cycloid_hub_height": (1.29, 1.36, 1.73),
    "cycloid_angular_speed": (0.34, 1.03, 1.60),
    "angular_momentum_range_x": (1.30, 1.29, 1.29),
    "angular_momentum_range_y": (0.94, 1.01, 1.01),
    "angular_momentum_range_z": (0.56, 0.53, 0.53),
    "limb_work_left_positive": (0.47, 0.114, 1.00),
    "limb_work_left_negative": (0.50, 0.135, 1.00),
    "limb_work_right_positive": (0.47, 0.114, 1.00),
    "limb_work_right_negative": (0.50, 0.135, 1.00),
}
"""Factors of the propagated deviation with all force measured, otherwise, and by markers alone; 1 if not listed."""
STRIDE_MEASURES: Final = ("stride_", "com_", "energy_", "external_", "angular_", "stance_", "swing_")
"""Beginnings of the names of measures that last from a strike to the next of the same foot."""
MEASURED_WORK_SD_J_KG: Final = 0.03
"""Propagated deviation of the work of a leg below which the force of both legs is measured throughout its stance."""


def calibrate_errors(motion: WalkMotion, steps: Sequence[GaitStep], measures: Iterable[Measure]) -> list[Measure]:
    """The measures with calibrated deviations; those without a deviation or of no step are unchanged."""
    calibrated = []
    for measure in measures:
        if measure.sd is not None and measure.step is not None and measure.name in FACTORS:
            factors = FACTORS[measure.name]
            if motion.by_markers:
                factor = factors[2]
            else:
                factor = factors[0 if is_measured(motion, steps[measure.step], measure) else 1]
            calibrated.append(replace(measure, sd=factor * measure.sd))
        else:
            calibrated.append(measure)
    return calibrated


def is_measured(motion: WalkMotion, step: GaitStep, measure: Measure) -> bool:
    """Whether all force is measured throughout the step (or stride, or stance) that ``measure`` is of."""
    if motion.covariance is None or not math.isfinite(step.period_s):
        return False
    if measure.name.startswith("limb_"):
        return measure.sd is not None and measure.sd < MEASURED_WORK_SD_J_KG
    span = motion.samples(step.lift_off_s, step.next_lift_off_s)
    if measure.name.startswith(STRIDE_MEASURES):
        span = motion.samples(step.strike_s, step.strike_s + 2.0 * step.period_s)
    variance = motion.covariance[span, UP, 1, 1]
    return bool(len(variance) and variance.max() < MEASURED_VELOCITY_SD_M_S**2)
