"""Calibration of the stated errors of measures on simulated walks, where the true values are known.

The propagated deviation of a measure of the CoM is that of the smoother's state at one instant. Most of this error is
the same throughout a stride (the segment table, the body mass, the tare of the plates) and cancels in a range, in an
excursion or in a mean; the state's covariance does not contain how it is correlated in time. So the deviation is
multiplied by the factor with which the 95 % band holds the truth in 95 % of the steps of 440 walks with seeds below 480
(``scripts/make_measures_coverage.py``); other seeds test it. The factors of times by plates are of 68 walks (even seeds
below 72 and from 7000 to 7070). There are two factors, for steps in which all force is
measured and for the others, where the velocity follows from markers.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Final

from stridelab.measures.measure import Measure
from stridelab.measures.walk_motion import UP, WalkMotion
from stridelab.walking.steps import GaitStep

MEASURED_VELOCITY_SD_M_S: Final = 0.01
"""Largest deviation of the vertical velocity of a step in which all force is measured."""
FACTORS: Final[Mapping[str, tuple[float, float, float]]] = {
    "step_length": (0.97, 0.96, 0.96),
    "step_width": (0.94, 1.00, 1.00),
    "walking_speed": (0.57, 1.26, 1.26),
    "step_time": (1.01, 1.01, 1.01),
    "cadence": (1.01, 1.01, 1.01),
    "double_support_share": (1.27, 1.00, 1.00),
    "stride_time": (1.00, 0.95, 0.95),
    "stance_share": (1.43, 0.99, 0.99),
    "swing_share": (1.43, 0.99, 0.99),
    "stride_length": (0.96, 0.96, 0.96),
    "com_vertical_excursion": (0.079, 0.31, 0.31),
    "com_lateral_excursion": (0.048, 0.23, 0.23),
    "com_speed": (0.2, 0.3, 0.3),
    "margin_of_stability_ml_min": (0.52, 0.35, 1.0),
    "margin_of_stability_ap_contact": (0.93, 0.68, 1.0),
    "margin_of_stability_ml_contact": (0.49, 0.32, 1.0),
    "capture_point_offset_ap": (0.94, 0.69, 1.0),
    "capture_point_offset_ml": (0.46, 0.31, 1.0),
    "energy_recovery": (0.20, 0.20, 1.0),
    "external_work": (0.12, 0.12, 1.0),
    "angular_momentum_range_x": (1.34, 1.37, 1.37),
    "angular_momentum_range_y": (0.99, 1.05, 1.05),
    "angular_momentum_range_z": (0.54, 0.55, 0.55),
    "limb_work_left_positive": (0.49, 0.14, 1.0),
    "limb_work_left_negative": (0.49, 0.14, 1.0),
    "limb_work_right_positive": (0.49, 0.14, 1.0),
    "limb_work_right_negative": (0.49, 0.14, 1.0),
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
    if motion.covariance is None:
        return False
    if measure.name.startswith("limb_"):
        return measure.sd is not None and measure.sd < MEASURED_WORK_SD_J_KG
    span = motion.samples(step.lift_off_s, step.next_lift_off_s)
    if measure.name.startswith(STRIDE_MEASURES):
        span = motion.samples(step.strike_s, step.strike_s + 2.0 * step.period_s)
    variance = motion.covariance[span, UP, 1, 1]
    return bool(len(variance) and variance.max() < MEASURED_VELOCITY_SD_M_S**2)
