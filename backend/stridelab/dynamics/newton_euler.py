"""Newton-Euler equations of the whole body (2.3)-(2.6), with gravity pointing down.

The thesis writes g upwards in chapter 2 and downwards in (4.2); here it is the one vector of ``conventions``, so that

    m c'' = f + m g                                   (2.3)
    L_c'  = nu - c x f                                (2.4), nu about the world origin
    m c x (c'' - g) + L_c' = nu                       (2.6), where the thesis prints L_c instead of its derivative

The derivation of the correction is in ``docs/theory/misprints.md``.
"""

import numpy as np

from stridelab.conventions import Points, g
from stridelab.dynamics.wrench import Wrench


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
