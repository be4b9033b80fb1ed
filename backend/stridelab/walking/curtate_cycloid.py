"""The rolling wheel (section 3.2.5): path of a point on the radius of a wheel that rolls without slipping.

    x = x0 + R theta - s r sin(theta)      (3.1)
    z = z0 - r cos(theta)                  (3.2)

The thesis uses s = +1 and no x0; without x0 the fit depends on the origin of the laboratory frame. For s = +1 the point
is slowest at the lowest point; the CoM of walkers is fastest there, which is s = -1 (a wheel of radius -R, seen from
its other side). Both branches are the same curve shifted by half a turn and mirrored vertically.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float

from stridelab.conventions import Series

Branch = Literal[1, -1]
"""s: +1 as in the thesis, -1 with the highest speed at the lowest point."""
Plane = Float[np.ndarray, "n 2"]
"""Positions ahead and up in the sagittal plane, in metres."""
FULL_TURN_RAD = 2 * np.pi


@dataclass(frozen=True, kw_only=True)
class Wheel:
    """R, r, z0 of (3.1) and (3.2) in metres, and x0, the position of the hub at theta = 0."""

    R_m: float
    r_m: float
    z0_m: float
    x0_m: float
    branch: Branch = 1

    def position_m(self, theta_rad: Series) -> Plane:
        """Positions of the point on the radius."""
        x = self.x0_m + self.R_m * theta_rad - self.branch * self.r_m * np.sin(theta_rad)
        return np.column_stack([x, self.z0_m - self.r_m * np.cos(theta_rad)])

    def hub_m(self, theta_rad: Series) -> Plane:
        """Positions of the wheel's centre (the yoyo-man model's moving frame, in which the point rotates)."""
        return np.column_stack([self.x0_m + self.R_m * theta_rad, np.full_like(theta_rad, self.z0_m)])

    def tangent_m(self, theta_rad: Series) -> Plane:
        """Derivative of the position with respect to theta."""
        ahead = self.R_m - self.branch * self.r_m * np.cos(theta_rad)
        return np.column_stack([ahead, self.r_m * np.sin(theta_rad)])

    @property
    def is_curtate(self) -> bool:
        """Whether the point is inside the wheel, so that it never moves backwards."""
        return 0.0 < self.r_m < abs(self.R_m)


def parameter_rows(theta_rad: Series, branch: Branch) -> tuple[Float[np.ndarray, "n 4"], Float[np.ndarray, "n 4"]]:
    """Derivatives of x and z with respect to (x0, R, r, z0), in which the model is linear."""
    ahead, up = np.zeros((2, len(theta_rad), 4))
    ahead[:, 0] = up[:, 3] = 1.0
    ahead[:, 1] = theta_rad
    ahead[:, 2] = -branch * np.sin(theta_rad)
    up[:, 2] = -np.cos(theta_rad)
    return ahead, up


@dataclass(frozen=True)
class Turn:
    """Equivalent parameters of a curve: ``theta_rad`` minus ``by_rad``, and the 4 x 4 ``change`` of (x0, R, r, z0)."""

    by_rad: float
    change: Float[np.ndarray, "4 4"]


def turn_to_zero(middle_rad: float, r_m: float) -> Turn:
    """Equivalent parameters with r > 0 and the middle of the step within half a turn of zero.

    A full turn moves x0 by 2 pi R; half a turn also changes the signs of sine and cosine, and thus that of r.
    """
    half = np.pi if r_m < 0.0 else 0.0
    by = FULL_TURN_RAD * float(np.round((middle_rad + half) / FULL_TURN_RAD)) - half
    change = np.diag([1.0, 1.0, -1.0 if half else 1.0, 1.0])
    change[0, 1] = by
    return Turn(by, change)
