"""Central axis of the contact wrench (2.10) and the projection of a point onto it (2.12).

    W_c = { f x nu / f.f + lambda n,  n = f / |f| }                   (2.10)
    c_p = f x nu / f.f + (c . n) n                                    (2.12)

Both hold for any origin, as long as nu and c refer to the same one: ``f x nu / f.f`` is the point of the axis that is
closest to that origin. On the axis the moment is along the force, ``(nu . n) n``, the smallest there is (2.14). Where
``L_c'`` vanishes ``c x f = nu`` (2.11), and the CoM lies on it.
"""

from dataclasses import dataclass

import numpy as np

from stridelab.conventions import Mask, Points, Series
from stridelab.dynamics.wrench import Wrench

AXIS_THRESHOLD_N = 100.0
"""Below this force the axis is not defined (section 2.6.2)."""


@dataclass(frozen=True)
class CentralAxis:
    """Central axis per sample: its point closest to the origin, its direction and the moment along it.

    Where the force is below the threshold the axis is undefined: ``defined`` is False and the values are NaN.
    ``pitch_moment_nm`` is nu . n, the moment along the axis.
    """

    point_m: Points
    direction: Points
    pitch_moment_nm: Series
    defined: Mask

    def project(self, point_m: Points) -> Points:
        """Orthogonal projection (2.12) of a point onto the axis; NaN where the axis is undefined."""
        n = self.direction
        return np.asarray(self.point_m + _dot(point_m, n)[:, None] * n)


def central_axis(wrench: Wrench, threshold_n: float = AXIS_THRESHOLD_N) -> CentralAxis:
    """Axis (2.10) of a wrench whose moment is about the origin of all points that will be projected.

    ``threshold_n`` must be positive.
    """
    f, nu = wrench.force_n, wrench.moment_nm
    squared = _dot(f, f)
    defined = squared > threshold_n**2
    squared = np.where(defined, squared, np.nan)[:, None]
    n = f / np.sqrt(squared)
    return CentralAxis(
        point_m=np.cross(f, nu) / squared,
        direction=n,
        pitch_moment_nm=_dot(nu, n),
        defined=defined,
    )


def _dot(u: Points, v: Points) -> Series:
    return np.asarray(np.einsum("ij,ij->i", u, v))
