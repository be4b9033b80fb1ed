"""Zero-moment point: from the wrench (2.7) for any contact plane, from the motion in full (2.8) and linearised (2.9).

The thesis prints ``L_c'^z`` in the second row of (2.8); ``L_c'^x`` is correct (see ``docs/theory/misprints.md``).
"""

import numpy as np
from jaxtyping import Float

from stridelab.conventions import GRAVITY_M_S2, Points, Series, Vector3
from stridelab.dynamics.wrench import Wrench, transport

PlanePoints = Float[np.ndarray, "n 2"]
"""Horizontal coordinates, one row per sample."""


def zmp_of_wrench(wrench: Wrench, plane_point_m: Vector3, normal: Vector3, threshold_n: float = 20.0) -> Points:
    """Point z of a contact plane (2.7) about which the moment is along the normal (2.13), in world coordinates.

    With q a point of the plane and n its unit normal: ``z = q + n x nu_q / (f . n)``; on the flat floor through the
    origin this is ``(-nu_y, nu_x, 0) / f_z``. NaN where the force along the normal is below ``threshold_n``.
    ``normal`` need not have unit length.
    """
    n = normal / np.linalg.norm(normal)
    about_q = transport(wrench, plane_point_m)
    f_n = about_q.force_n @ n
    f_n = np.where(f_n > threshold_n, f_n, np.nan)
    return np.asarray(plane_point_m + np.cross(n, about_q.moment_nm) / f_n[:, None])


def zmp_of_motion(
    com_m: Points,
    acceleration_m_s2: Points,
    momentum_rate_nm: Points,
    mass_kg: float,
    floor_height_m: float = 0.0,
) -> PlanePoints:
    """ZMP on a horizontal floor from the motion (2.8), exact; x and y per sample.

    ``z^xy = c^xy - (c^z - h) / (c''^z + 9.81) c''^xy + (-L_c'^y, L_c'^x) / (m (c''^z + 9.81))``.
    NaN in free fall, where the denominator vanishes.
    """
    c, a, l_dot = com_m, acceleration_m_s2, momentum_rate_nm
    lift = a[:, 2] + GRAVITY_M_S2
    lift = np.where(lift > 0, lift, np.nan)[:, None]
    height = (c[:, 2] - floor_height_m)[:, None]
    turn = np.column_stack([-l_dot[:, 1], l_dot[:, 0]])
    return np.asarray(c[:, :2] - height / lift * a[:, :2] + turn / (mass_kg * lift))


def zmp_linearised(com_m: Points, acceleration_m_s2: Points, height_m: float | Series | None = None) -> PlanePoints:
    """ZMP of the cart-table model (2.9): constant height, no angular momentum; x and y per sample.

    ``height_m`` of the CoM above the floor defaults to the z coordinate of the CoM.
    """
    h = com_m[:, 2] if height_m is None else np.broadcast_to(height_m, com_m[:, 2].shape)
    return np.asarray(com_m[:, :2] - (h / GRAVITY_M_S2)[:, None] * acceleration_m_s2[:, :2])
