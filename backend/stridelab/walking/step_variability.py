"""Strike-to-strike intervals between the steps, and how much the wheel differs from step to step.

Two plates measure one whole step and most of the next. Between two strikes (double and then single support) lies a
second interval that overlaps with the step by its double support: the least that can be said of the scatter.
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
from stridelab.walking.step_fit import StepFit, sagittal_path_m, samples_of
from stridelab.walking.steps import GaitStep


@dataclass(frozen=True)
class Overlap:
    """The wheel from one strike to the next, with the slope of the line through theta_k."""

    start_s: float
    end_s: float
    wheel: Wheel
    omega_rad_s: float
    error_mean_m: float


@dataclass(frozen=True)
class Scatter:
    """Standard deviation (n - 1) of the wheels of one recording."""

    R_m: float
    r_m: float
    z0_m: float
    omega_rad_s: float
    n: int
    between: Literal["steps", "overlapping-steps"]


def strike_to_strike(
    estimate: ComEstimate, steps: Sequence[GaitStep], windows: Sequence[Window], ahead: Vector3
) -> tuple[Overlap, ...]:
    """Wheels of all intervals between two strikes inside one of ``windows``; up to 8 % may lack at an end."""
    path = sagittal_path_m(estimate, ahead)
    found = []
    for step in steps:
        start_s, end_s = step.prior_strike_s, step.strike_s
        kept = None if start_s is None else samples_of(estimate.time_s, start_s, end_s, windows)
        if start_s is None or kept is None:
            continue
        time_s = estimate.time_s[kept]
        fit = fit_path(time_s, path[kept], step.period_s)
        omega = float(np.polyfit(time_s, fit.theta_rad, 1)[0])
        found.append(Overlap(start_s, end_s, fit.wheel, omega, float(fit.distance_m.mean())))
    return tuple(found)


def scatter(fits: Sequence[StepFit], overlaps: Sequence[Overlap]) -> Scatter | None:
    """Between the steps where there are two; else between one step and what overlaps with it; None without that."""
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
