"""Where a fit of the wheel begins: the wheel that rolls once per step at the mean speed."""

from dataclasses import dataclass

import numpy as np

from stridelab.conventions import Series
from stridelab.walking.checked_path import require_path
from stridelab.walking.curtate_cycloid import Branch, FullTurn, Plane, Wheel

LEAST_RADIUS_M = 1e-3


@dataclass(frozen=True)
class FirstGuess:
    """A wheel and the affine clock ``theta0_rad + omega_rad_s * (t - t[0])`` that goes with it."""

    wheel: Wheel
    theta0_rad: float
    omega_rad_s: float

    def theta_rad(self, time_s: Series) -> Series:
        """The angle at the samples."""
        return np.asarray(self.theta0_rad + self.omega_rad_s * (time_s - time_s[0]))


def first_guess(time_s: Series, path_m: Plane, step_period_s: float, branch: Branch) -> FirstGuess:
    """From the mean speed, the step period and the phase of the height; theta is within half a turn in mid-step.

    Raises what ``require_path`` does.
    """
    require_path(time_s, path_m, step_period_s)
    t, x, z = time_s - time_s[0], path_m[:, 0], path_m[:, 1]
    omega = FullTurn / step_period_s
    speed = np.polyfit(t, x, 1)[0]
    waves = np.column_stack([np.cos(omega * t), np.sin(omega * t), np.ones_like(t)])
    (cos, sin, _), *_ = np.linalg.lstsq(waves, z, rcond=None)
    theta0 = float(np.arctan2(sin, -cos))  # z = z0 - r cos(theta0 + omega t)
    theta0 -= FullTurn * np.round((theta0 + omega * t[-1] / 2) / FullTurn)
    R = speed / omega
    r = max((z.max() - z.min()) / 2, LEAST_RADIUS_M)
    x0 = float(np.mean(x - R * (theta0 + omega * t)))
    wheel = Wheel(R_m=float(R), r_m=float(r), z0_m=float(z.max() + z.min()) / 2, x0_m=x0, branch=branch)
    return FirstGuess(wheel, theta0, float(omega))
