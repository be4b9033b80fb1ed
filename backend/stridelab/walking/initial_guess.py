"""Validates the path of a step and computes the initial guess of a fit: a wheel that rolls once per step."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from stridelab.conventions import Series
from stridelab.errors import Fault, InvalidInput, NotEstimable
from stridelab.walking.curtate_cycloid import FULL_TURN_RAD, Branch, Plane, Wheel

MIN_SAMPLES: Final = 8
"""Twice the parameters of the wheel."""
MIN_ADVANCE_M: Final = 0.05
"""Minimum advance in a step: swaying in place moves less, walking ten times more."""
STEP_PERIOD_RANGE_S: Final = (0.1, 3.0)
"""Valid range of the step period."""


def require_path(time_s: Series, path_m: Plane, step_period_s: float) -> None:
    """Raise unless ``path_m`` can be a step.

    Raises ``InvalidInput``: ``path-not-finite``, ``time-not-increasing``, ``period-out-of-range``; and
    ``NotEstimable``: ``too-few-samples``, or ``no-progress`` (standing, or a treadmill whose belt moves instead of the
    body).
    """
    if len(time_s) < MIN_SAMPLES:
        message = f"The step has {len(time_s)} samples; the fit of a wheel needs at least {MIN_SAMPLES}."
        raise NotEstimable("too-few-samples", message)
    good = np.isfinite(path_m).all(axis=1) & np.isfinite(time_s)
    if not good.all():
        first = int(np.flatnonzero(~good)[0])
        message = f"The centre of mass is not known at {np.count_nonzero(~good)} of {len(good)} samples of the step."
        raise InvalidInput("path-not-finite", message, [Fault(f"path_m[{first}]", "not a finite number")])
    if not (np.diff(time_s) > 0).all():
        first = int(np.flatnonzero(np.diff(time_s) <= 0)[0]) + 1
        message = "The instants of the samples must increase."
        raise InvalidInput("time-not-increasing", message, [Fault(f"time_s[{first}]", "not after the one before")])
    low, high = STEP_PERIOD_RANGE_S
    if not low <= step_period_s <= high:
        message = f"A step cannot take {step_period_s:g} s; it takes {low:g} to {high:g} s."
        raise InvalidInput("period-out-of-range", message, [Fault("period_s", message)])
    advance = float(np.ptp(path_m[:, 0]))
    if advance < MIN_ADVANCE_M:
        raise NotEstimable(
            "no-progress",
            f"The centre of mass advances by only {1e3 * advance:.0f} mm, so no rolling wheel can be fitted. "
            "Is the subject standing, or walking on a treadmill?",
        )


MIN_RADIUS_M = 1e-3


@dataclass(frozen=True)
class FirstGuess:
    """A wheel with its angle ``theta0_rad + omega_rad_s * (t - t[0])``."""

    wheel: Wheel
    theta0_rad: float
    omega_rad_s: float

    def theta_rad(self, time_s: Series) -> Series:
        """Angle at the samples."""
        return np.asarray(self.theta0_rad + self.omega_rad_s * (time_s - time_s[0]))


def first_guess(time_s: Series, path_m: Plane, step_period_s: float, branch: Branch) -> FirstGuess:
    """Initial wheel from mean speed, step period and phase of the height; theta is within half a turn in mid-step.

    Raises as ``require_path`` does.
    """
    require_path(time_s, path_m, step_period_s)
    t, x, z = time_s - time_s[0], path_m[:, 0], path_m[:, 1]
    omega = FULL_TURN_RAD / step_period_s
    speed = np.polyfit(t, x, 1)[0]
    waves = np.column_stack([np.cos(omega * t), np.sin(omega * t), np.ones_like(t)])
    (cos, sin, _), *_ = np.linalg.lstsq(waves, z, rcond=None)
    theta0 = float(np.arctan2(sin, -cos))  # z = z0 - r cos(theta0 + omega t)
    theta0 -= FULL_TURN_RAD * np.round((theta0 + omega * t[-1] / 2) / FULL_TURN_RAD)
    R = speed / omega
    r = max((z.max() - z.min()) / 2, MIN_RADIUS_M)
    x0 = float(np.mean(x - R * (theta0 + omega * t)))
    wheel = Wheel(R_m=float(R), r_m=float(r), z0_m=float(z.max() + z.min()) / 2, x0_m=x0, branch=branch)
    return FirstGuess(wheel, theta0, float(omega))
