"""Centre of mass that keeps the zero-moment point where the feet are meant to press.

Moments about the point ``p`` on the ground vanish horizontally (2.7); with ``dL``, the rate of the angular momentum
about the centre of mass, that is the corrected (2.8):

    p_x = c_x - c_z c_x'' / (c_z'' + g) - dL_y / (m (c_z'' + g))
    p_y = c_y - c_z c_y'' / (c_z'' + g) + dL_x / (m (c_z'' + g))

For given ``p``, ``c_z`` and ``dL`` this is a linear boundary-value problem for ``c_x`` and ``c_y``: its solution
between two rests is the bounded one, i.e. the linear inverted pendulum with an infinite preview (Kajita 2003), with
the height's acceleration and the angular momentum taken in exactly (``dL`` comes from the previous whole-body pass).
"""

import numpy as np
from scipy.linalg import solve_banded

from stridelab.conventions import GRAVITY_M_S2, Points, Series
from stridelab.experiments.load_plan import Plane


def com_over_zmp(zmp_m: Plane, height_m: Series, momentum_rate_nm: Points, mass_kg: float, dt_s: float) -> Points:
    """Centre of mass whose zero-moment point is ``zmp_m`` (finite differences; at rest at both ends)."""
    n = len(height_m)
    lift = np.gradient(np.gradient(height_m, dt_s), dt_s) + GRAVITY_M_S2  # c_z'' + g
    stiffness = height_m / lift / dt_s**2
    dL = momentum_rate_nm / (mass_kg * lift[:, None])
    target = zmp_m + np.column_stack([dL[:, 1], -dL[:, 0]])
    bands = np.zeros((3, n))
    bands[0, 2:] = -stiffness[1:-1]
    bands[1] = 1.0 + 2.0 * stiffness
    bands[2, :-2] = -stiffness[1:-1]
    bands[1, [0, -1]] = 1.0
    return np.column_stack([solve_banded((1, 1), bands, target), height_m])
