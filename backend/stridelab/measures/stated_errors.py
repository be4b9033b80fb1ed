"""Calibration of the stated errors of measures on simulated walks, where the true values are known.

The propagated deviation of a measure of the CoM is that of the smoother's state at one instant. Most of this error is
the same throughout a stride (the segment table, the body mass, the tare of the plates) and cancels in a range, in an
excursion or in a mean; the state's covariance does not contain how it is correlated in time. So the deviation is
multiplied by the factor with which the 95 % band holds the truth in 95 % of the steps of walks with seeds from 0 to 219
(``scripts/make_measures_coverage.py``); other seeds test it. There are two factors, for steps in which all force is
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
FACTORS: Final[Mapping[str, tuple[float, float]]] = {
}
"""Factors of the propagated deviation with all force measured, and otherwise; 1 for measures that are not listed."""
STRIDE_MEASURES: Final = ("stride_", "com_", "energy_", "external_", "angular_", "limb_", "stance_", "swing_")
"""Beginnings of the names of measures that last from a strike to the next of the same foot."""


def calibrate_errors(motion: WalkMotion, steps: Sequence[GaitStep], measures: Iterable[Measure]) -> list[Measure]:
    """The measures with calibrated deviations; those without a deviation or of no step are unchanged."""
    calibrated = []
    for measure in measures:
        if measure.sd is not None and measure.step is not None and measure.name in FACTORS:
            factor = FACTORS[measure.name][0 if is_measured(motion, steps[measure.step], measure.name) else 1]
            calibrated.append(replace(measure, sd=factor * measure.sd))
        else:
            calibrated.append(measure)
    return calibrated


def is_measured(motion: WalkMotion, step: GaitStep, name: str) -> bool:
    """Whether all force is measured throughout the step (or stride) that the measure ``name`` is of."""
    if motion.covariance is None:
        return False
    span = motion.samples(step.lift_off_s, step.next_lift_off_s)
    if name.startswith(STRIDE_MEASURES):
        span = motion.samples(step.strike_s, step.strike_s + 2.0 * step.period_s)
    variance = motion.covariance[span, UP, 1, 1]
    return bool(len(variance) and variance.max() < MEASURED_VELOCITY_SD_M_S**2)
