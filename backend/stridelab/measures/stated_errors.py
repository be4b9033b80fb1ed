"""Calibration of the stated errors of measures on simulated walks, where the true values are known.

The propagated deviation of a measure of the CoM is that of the smoother's state at one instant. Most of this error is
the same throughout a stride (the segment table, the body mass, the tare of the plates) and cancels in a range, in an
excursion or in a mean; the state's covariance does not contain how it is correlated in time. So the deviation is
multiplied by the factor with which the 95 % band holds the truth in 95 % of the steps of walks whose markers move with
the skin (``scripts/make_measures_coverage.py``, even seeds 6000 to 6198 and 8000 to 8398 over a walkway, odd seeds 6001
to 6199 over two plates, odd seeds 3001 to 3299 by markers; six of them on 33000 to 33399); other seeds test it. There
are three: for steps in which all force is measured, for the others, where the velocity follows from markers, and for a
CoM of the markers alone. What events and markers of the feet add to the error of a margin (``Measure.events_sd``) has
no factor, nor do times and the widths of steps. Errors of the pelvis and of the angular momentum have the same cause in
all three and nearly one factor. Of the markers alone, the sideways margins and the speed of the CoM are those of people
(``MARKERS_ALONE_SD``): strides of a simulated walk repeat, so that errors cancel in a speed over one.
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
    "step_length": (1.14, 1, 1),
    "walking_speed": (1.2, 1.2, 1.35),
    "stride_length": (0.99, 0.99, 0.59),
    "com_vertical_excursion": (0.22, 0.88, 0.67),
    "com_lateral_excursion": (0.063, 0.78, 0.61),
    "com_speed": (0.118, 0.79, 1),
    "margin_of_stability_ml_min": (0.34, 0.48, 1),
    "margin_of_stability_ap_contact": (1.4, 0.57, 1.22),
    "margin_of_stability_ml_contact": (0.32, 0.42, 1),
    "capture_point_offset_ap": (1.37, 0.61, 1.52),
    "capture_point_offset_ml": (0.3, 0.42, 1),
    "energy_recovery": (0.2, 0.2, 3.2),
    "external_work": (0.134, 0.134, 0.72),
    "step_energy_recovery": (1, 1, 3.2),
    "step_external_work": (1, 1, 0.72),
    "cycloid_wheel_radius": (0.83, 2.5, 0.79),
    "cycloid_point_radius": (0.79, 2.71, 0.69),
    "cycloid_hub_height": (1.43, 1.37, 1.76),
    "cycloid_angular_speed": (0.88, 2.5, 0.6),
    "angular_momentum_range_x": (1.8, 1.75, 1.75),
    "angular_momentum_range_y": (1, 1, 1),
    "angular_momentum_range_z": (0.64, 0.57, 0.6),
    "limb_work_right_negative": (0.79, 0.28, 1),
    "limb_work_right_positive": (0.76, 0.24, 1),
    "limb_work_left_positive": (0.76, 0.27, 1),
    "limb_work_left_negative": (0.8, 0.29, 1),
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
            scaled = max(measure.sd**2 - measure.events_sd**2, 0.0)
            calibrated.append(replace(measure, sd=math.hypot(factor * math.sqrt(scaled), measure.events_sd)))
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
