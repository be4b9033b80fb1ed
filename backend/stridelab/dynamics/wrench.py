"""Total contact wrench (2.5): force and moment on the body about a given point, with gravity pointing down.

Standing still the contact force is ``f = -m g = (0, 0, +9.81 m)``: the ground pushes the body up.

Central axis of the contact wrench (2.10) and the projection of a point onto it (2.12).

    W_c = { f x nu / f.f + lambda n,  n = f / |f| }                   (2.10)
    c_p = f x nu / f.f + (c . n) n                                    (2.12)

Both hold for any origin, as long as nu and c refer to the same one: ``f x nu / f.f`` is the point of the axis that is
closest to that origin. On the axis the moment is along the force, ``(nu . n) n``, the smallest there is (2.14). Where
``L_c'`` vanishes ``c x f = nu`` (2.11), and the CoM lies on it.

Newton-Euler equations of the whole body (2.3)-(2.6), with gravity pointing down.

The thesis writes g upwards in chapter 2 and downwards in (4.2); here it is the one vector of ``conventions``, so that

    m c'' = f + m g                                   (2.3)
    L_c'  = nu - c x f                                (2.4), nu about the world origin
    m c x (c'' - g) + L_c' = nu                       (2.6), where the thesis prints L_c instead of its derivative

The derivation of the correction is in ``docs/theory/misprints.md``.

Zero-moment point: from the wrench (2.7) for any contact plane, from the motion in full (2.8) and linearised (2.9).

The thesis prints ``L_c'^z`` in the second row of (2.8); ``L_c'^x`` is correct (see ``docs/theory/misprints.md``).
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from stridelab.conventions import GRAVITY_M_S2, Mask, Points, Series, Vector3, g

ContactPoints = Float[np.ndarray, "contacts n 3"]
"""One point, force or moment per contact and sample."""


@dataclass(frozen=True)
class Wrench:
    """Force and moment on the body, one row per sample; the moment is about the world origin unless transported."""

    force_n: Points
    moment_nm: Points


def total_wrench(position_m: ContactPoints, force_n: ContactPoints, moment_nm: ContactPoints) -> Wrench:
    """Sum of any number of contacts (2.5): ``f_c = sum f_i``, ``nu_c = sum p_i x f_i + nu_i``.

    ``moment_nm[i]`` is the moment that contact i exerts about its own point ``position_m[i]``. Without contacts
    (shape ``(0, n, 3)``, flight) the wrench is zero.
    """
    return Wrench(
        force_n=force_n.sum(axis=0),
        moment_nm=(np.cross(position_m, force_n) + moment_nm).sum(axis=0),
    )


def transport(wrench: Wrench, displacement_m: Points | Vector3) -> Wrench:
    """Express the wrench about a point displaced by ``displacement_m``: ``nu_P = nu_O - OP x f``.

    Transporting by p and then by q equals transporting by p + q.
    """
    return Wrench(
        force_n=wrench.force_n,
        moment_nm=wrench.moment_nm - np.cross(np.broadcast_to(displacement_m, wrench.force_n.shape), wrench.force_n),
    )


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


def com_acceleration(force_n: Points, mass_kg: float) -> Points:
    """Acceleration of the CoM under the total contact force (2.3), in m/s^2."""
    return np.asarray(force_n / mass_kg + g)


def contact_force(acceleration_m_s2: Points, mass_kg: float) -> Points:
    """Total contact force that a CoM acceleration needs (2.3); standing still it is ``(0, 0, +9.81 m)``."""
    return np.asarray(mass_kg * (acceleration_m_s2 - g))


def contact_wrench(com_m: Points, acceleration_m_s2: Points, momentum_rate_nm: Points, mass_kg: float) -> Wrench:
    """Contact wrench at the world origin that a motion needs (2.6).

    ``momentum_rate_nm`` is L_c', the rate of the angular momentum about the CoM.
    """
    f = contact_force(acceleration_m_s2, mass_kg)
    return Wrench(force_n=f, moment_nm=np.cross(com_m, f) + momentum_rate_nm)


def momentum_rate(com_m: Points, wrench: Wrench) -> Points:
    """Rate of the angular momentum about the CoM, L_c' (2.4), from a wrench at the world origin, in Nm."""
    return wrench.moment_nm - np.cross(com_m, wrench.force_n)


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
