"""Strike-to-strike intervals between the steps, and the variability of the wheel from step to step.

Two plates measure one whole step and most of the next. The interval between two strikes (double, then single support)
overlaps with the step by its double support; it allows a minimal estimate of the variability.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from stridelab.conventions import Vector3
from stridelab.estimation.estimator import ComEstimate
from stridelab.recordings.recording import Window
from stridelab.walking.curtate_cycloid import Wheel
from stridelab.walking.path_fit import fit_path
from stridelab.walking.step_fit import StepFit, sagittal_path_m, select_samples
from stridelab.walking.steps import GaitStep


@dataclass(frozen=True)
class Overlap:
    """Wheel fitted from one strike to the next, with the slope of the line through theta_k."""

    start_s: float
    end_s: float
    wheel: Wheel
    omega_rad_s: float
    error_mean_m: float


@dataclass(frozen=True)
class Scatter:
    """Standard deviations (n - 1) of the wheel parameters of one recording."""

    R_m: float
    r_m: float
    z0_m: float
    omega_rad_s: float
    n: int
    between: Literal["steps", "overlapping-steps"]


def strike_to_strike(
    estimate: ComEstimate, steps: Sequence[GaitStep], windows: Sequence[Window], ahead: Vector3
) -> tuple[Overlap, ...]:
    """Fit the wheel to all strike-to-strike intervals inside ``windows``; up to 8 % may be missing at an end."""
    path = sagittal_path_m(estimate, ahead)
    overlaps = []
    for step in steps:
        start_s, end_s = step.prior_strike_s, step.strike_s
        samples = None if start_s is None else select_samples(estimate.time_s, start_s, end_s, windows)
        if start_s is None or samples is None:
            continue
        time_s = estimate.time_s[samples]
        fit = fit_path(time_s, path[samples], step.period_s)
        omega = float(np.polyfit(time_s, fit.theta_rad, 1)[0])
        overlaps.append(Overlap(start_s, end_s, fit.wheel, omega, float(fit.distance_m.mean())))
    return tuple(overlaps)


def step_scatter(fits: Sequence[StepFit], overlaps: Sequence[Overlap]) -> Scatter | None:
    """Variability between the steps if there are two, else between one step and the overlapping interval, else None."""
    rows = [(f.path.wheel, f.omega_rad_s) for f in fits]
    between: Literal["steps", "overlapping-steps"] = "steps"
    if len(rows) < 2:
        rows += [(o.wheel, o.omega_rad_s) for o in overlaps]
        between = "overlapping-steps"
    if len(rows) < 2:
        return None
    table = np.array([[wheel.R_m, wheel.r_m, wheel.z0_m, omega] for wheel, omega in rows])
    R, r, z0, omega = (float(v) for v in np.std(table, axis=0, ddof=1))
    return Scatter(R, r, z0, omega, len(rows), between)
