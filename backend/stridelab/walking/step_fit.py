"""Fits the wheel to every step of an estimated walk, as a path and in time, on both branches."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from stridelab.conventions import Mask, Series, Vector3
from stridelab.errors import NotEstimable
from stridelab.estimation.estimator import ComEstimate
from stridelab.recordings.recording import Window
from stridelab.walking.alternative_models import ModelScore, StepData, compare_path_models, compare_time_models
from stridelab.walking.curtate_cycloid import FULL_TURN_RAD, Plane
from stridelab.walking.double_support import double_support_of_wheel
from stridelab.walking.path_fit import PathFit, fit_path
from stridelab.walking.steps import MAX_MISSING_SHARE, GaitStep
from stridelab.walking.timed_fit import TimedFit, fit_in_time

MIN_SAMPLES: Final = 20
LARGEST_R_M: Final = 0.1
"""Largest plausible r: the CoM of a walker moves vertically by less than 20 cm."""
MIN_R_M: Final = 0.001
"""Smallest r for which the height determines the angle."""
MAX_MEAN_DISTANCE_M: Final = 0.004
"""Mean distance from the curve above which the step is flagged; at most 3.5 mm in the thesis."""
MIN_TURN_SHARE: Final = 0.75
"""Share of a turn below which the curve is too short to distinguish R from r."""
EDGE_S: Final = 1e-6
"""Tolerance of instants, which files store in single precision."""


@dataclass(frozen=True)
class StepFit:
    """All fits of one step; ``path`` is the thesis' branch, ``reversed_path`` the other.

    ``theta0_rad`` and ``omega_rad_s`` are those of the line through theta_k (the thesis' last step before (3.4)), with
    ``theta_off_line_rad`` the RMS deviation from it. ``flags`` are stable codes of warnings about the fit.
    """

    step: GaitStep
    time_s: Series
    path_m: Plane
    path: PathFit
    reversed_path: PathFit
    timed: TimedFit
    reversed_timed: TimedFit
    theta0_rad: float
    omega_rad_s: float
    theta_off_line_rad: float
    flags: tuple[str, ...]

    @property
    def circumference_share(self) -> float | None:
        """2 pi R over the measured step length: 1 for a wheel that turns once per step."""
        length = self.step.length_m
        return None if not length else float(FULL_TURN_RAD * self.path.wheel.R_m / length)

    @cached_property
    def path_rivals(self) -> tuple[ModelScore, ...]:
        """Comparison with simpler path models; computed on first access because it takes half the time of a fit."""
        return compare_path_models(self._step_data)

    @cached_property
    def time_rivals(self) -> tuple[ModelScore, ...]:
        """Comparison of the wheel with constant speed with simpler motion models."""
        return compare_time_models(self._step_data)

    @property
    def _step_data(self) -> StepData:
        double = (self.time_s >= self.step.strike_s) & (self.time_s <= self.step.next_lift_off_s)
        return StepData(self.time_s, self.path_m, self.step.period_s, double)

    @property
    def double_support_model_s(self) -> tuple[float | None, float | None]:
        """Double support by the rule of section 3.3.3; ``step.double_support_s`` is the measured one."""
        return double_support_of_wheel(self.path, self.time_s, (self.step.strike_s + self.step.next_lift_off_s) / 2)


def fit_steps(
    estimate: ComEstimate, steps: Sequence[GaitStep], ahead: Vector3, windows: Sequence[Window] = ()
) -> tuple[StepFit, ...]:
    """Fit all steps that lie inside the estimate; ``ahead`` is the horizontal unit vector of the walk.

    Only samples inside the step are used, because the curve is steep at both ends. For a measured step, only samples
    inside one of ``windows`` (if given) are used, where the centre of mass is most accurate. Up to 8 % of the step may
    be missing at an end. A step that cannot be fitted is omitted. Raises ``NotEstimable`` (``no-whole-step``) if no
    step lies inside, or the error of the last step if none can be fitted.
    """
    path = sagittal_path_m(estimate, ahead)
    fits = []
    failure = NotEstimable(
        "no-whole-step",
        "No step (lift-off to the next lift-off) lies entirely inside the time in which the centre of mass is known.",
    )
    for step in steps:
        samples = select_samples(estimate.time_s, step.start_s, step.end_s, windows if step.measured else ())
        if samples is None:
            continue
        try:
            fits.append(fit_step(step, estimate.time_s[samples], path[samples]))
        except NotEstimable as error:
            failure = error
    if not fits:
        raise failure
    return tuple(fits)


def select_samples(time_s: Series, start_s: float, end_s: float, windows: Sequence[Window]) -> Mask | None:
    """Samples from start to end inside one of ``windows`` (if any); None if too many are missing."""
    slack_s = MAX_MISSING_SHARE * (end_s - start_s)
    inside = [(max(w.start_s, start_s), min(w.end_s, end_s)) for w in windows] or [(start_s, end_s)]
    first_s, last_s = max(inside, key=lambda part: part[1] - part[0])
    selected = (time_s >= first_s - EDGE_S) & (time_s <= last_s + EDGE_S)
    if selected.sum() < MIN_SAMPLES:
        return None
    frame_s = float(np.median(np.diff(time_s)))
    missing_s = max(time_s[selected][0] - start_s, end_s - time_s[selected][-1])
    return selected if missing_s <= slack_s + frame_s else None


def sagittal_path_m(estimate: ComEstimate, ahead: Vector3) -> Plane:
    """Position of the CoM ahead and up; only the horizontal direction of ``ahead`` is used."""
    forward = ahead * [1.0, 1.0, 0.0] / np.linalg.norm(ahead[:2])
    return np.column_stack([estimate.com_m @ forward, estimate.com_m[:, 2]])


def fit_step(step: GaitStep, time_s: Series, path_m: Plane) -> StepFit:
    """Compute all fits of one step; ``path_m`` is ahead and up at ``time_s``.

    Raises ``InvalidInput`` or ``NotEstimable`` as ``require_path`` does.
    """
    period = step.period_s
    path, other = (fit_path(time_s, path_m, period, s) for s in (1, -1))
    timed, other_timed = (fit_in_time(time_s, path_m, period, s) for s in (1, -1))
    t = time_s - time_s[0]
    omega, theta0 = (float(v) for v in np.polyfit(t, path.theta_rad, 1))
    off_line = float(np.std(path.theta_rad - theta0 - omega * t))
    return StepFit(
        step=step,
        time_s=time_s,
        path_m=path_m,
        path=path,
        reversed_path=other,
        timed=timed,
        reversed_timed=other_timed,
        theta0_rad=theta0,
        omega_rad_s=omega,
        theta_off_line_rad=off_line,
        flags=_fit_flags(path, timed),
    )


def _fit_flags(path: PathFit, timed: TimedFit) -> tuple[str, ...]:
    seen = {f"timed-{bound}": True for bound in timed.bounds}
    wheel, turned = path.wheel, float(np.ptp(path.theta_rad)) / FULL_TURN_RAD
    return tuple(
        flag
        for flag, holds in {
            **seen,
            "path-not-converged": not path.converged,
            "backwards": wheel.R_m < 0.0,
            "r-too-large": wheel.r_m > LARGEST_R_M,
            "r-too-small": wheel.r_m < MIN_R_M,
            "not-curtate": not wheel.is_curtate,
            "theta-not-monotone": not (np.diff(path.theta_rad) > 0).all(),
            "part-of-a-turn": turned < MIN_TURN_SHARE,
            "far-from-the-wheel": float(path.distance_m.mean()) > MAX_MEAN_DISTANCE_M,
        }.items()
        if holds
    )
