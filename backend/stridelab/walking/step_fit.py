"""The wheel of every step of an estimated walk: as a path on both branches, and as a clock."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from stridelab.conventions import Series, Vector3
from stridelab.errors import NotEstimable
from stridelab.estimation.estimate import ComEstimate
from stridelab.walking.curtate_cycloid import Plane
from stridelab.walking.gait_step import GaitStep
from stridelab.walking.path_fit import PathFit, fit_path
from stridelab.walking.rivals import Contest, Step, path_contest, time_contest
from stridelab.walking.timed_fit import TimedFit, fit_in_time

LEAST_SAMPLES: Final = 20
LARGEST_R_M: Final = 0.1
"""A CoM that goes up and down by more than 20 cm does not walk."""


@dataclass(frozen=True)
class StepFit:
    """One step and everything that was fitted to it; ``path`` is the thesis' branch, ``reversed_path`` the other.

    ``theta0_rad`` and ``omega_rad_s`` are those of the line through theta_k (the thesis' last step before (3.4)), with
    ``theta_off_line_rad`` its RMS distance. ``flags`` are stable codes of what must be known before a number is used.
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
    path_rivals: tuple[Contest, ...]
    time_rivals: tuple[Contest, ...]
    flags: tuple[str, ...]

    @property
    def circumference_share(self) -> float | None:
        """2 pi R over the measured step length; a wheel that turns once per step has 1."""
        length = self.step.length_m
        return None if length is None else float(2 * np.pi * self.path.wheel.R_m / length)


def fit_steps(estimate: ComEstimate, steps: Sequence[GaitStep], ahead: Vector3) -> tuple[StepFit, ...]:
    """Fits of all steps that lie inside the estimate; ``ahead`` is the horizontal unit vector of the walk.

    Raises ``NotEstimable`` ("no-whole-step") where none does.
    """
    forward = ahead * [1.0, 1.0, 0.0] / np.linalg.norm(ahead[:2])
    path = np.column_stack([estimate.com_m @ forward, estimate.com_m[:, 2]])
    half = 0.5 * float(np.median(np.diff(estimate.time_s)))
    found = []
    for step in steps:
        kept = (estimate.time_s >= step.start_s - half) & (estimate.time_s <= step.end_s + half)
        covered = estimate.time_s[0] <= step.start_s + half and estimate.time_s[-1] >= step.end_s - half
        if covered and kept.sum() >= LEAST_SAMPLES:
            found.append(fit_step(step, estimate.time_s[kept], path[kept]))
    if not found:
        raise NotEstimable(
            "no-whole-step",
            "No step (lift-off to the next lift-off) lies wholly inside the time in which the centre of mass is known.",
        )
    return tuple(found)


def fit_step(step: GaitStep, time_s: Series, path_m: Plane) -> StepFit:
    """All fits of one step; ``path_m`` is ahead and up at ``time_s``."""
    period = step.period_s
    path, other = (fit_path(time_s, path_m, period, s) for s in (1, -1))
    timed, other_timed = (fit_in_time(time_s, path_m, period, s) for s in (1, -1))
    t = time_s - time_s[0]
    omega, theta0 = (float(v) for v in np.polyfit(t, path.theta_rad, 1))
    off_line = float(np.std(path.theta_rad - theta0 - omega * t))
    double = (time_s >= step.strike_s) & (time_s <= step.next_lift_off_s)
    rival = Step(time_s, path_m, period, double)
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
        path_rivals=path_contest(rival),
        time_rivals=time_contest(rival),
        flags=_flags(path, timed),
    )


def _flags(path: PathFit, timed: TimedFit) -> tuple[str, ...]:
    flags = [f"timed-{bound}" for bound in timed.bounds]
    if not path.converged:
        flags.append("path-not-converged")
    if path.wheel.r_m > LARGEST_R_M:
        flags.append("r-too-large")
    if not path.wheel.curtate:
        flags.append("not-curtate")
    if not (np.diff(path.theta_rad) > 0).all():
        flags.append("theta-not-monotone")
    return tuple(flags)
