"""Exact centre of mass, momentum and contact wrench of a motion.

    m c'' = f + m g              (4.2a)
    dL/dt = tau_o - c x f        (4.2b), L the angular momentum about the centre of mass

so that the wrench at the world origin is ``f = m (c'' - g)``, ``tau_o = c x f + dL/dt``. Momenta and their rates come
from Pinocchio's centroidal algorithm with the spline's own first and second derivative.
"""

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from jaxtyping import Float
from scipy.interpolate import BSpline

from stridelab.conventions import Points, Series
from stridelab.dynamics.wrench import Wrench, contact_wrench
from stridelab.simulation.human.body_model import AnthropometricBody


@dataclass(frozen=True)
class TrueMotion:
    """Exact motion and mechanics. Angular momentum is about the centre of mass."""

    time_s: Series
    mass_kg: float
    com_m: Points
    velocity_m_s: Points
    acceleration_m_s2: Points
    momentum_nms: Points
    momentum_rate_nm: Points

    @property
    def force_n(self) -> Points:
        """Total contact force on the body."""
        return self.wrench.force_n

    @property
    def moment_nm(self) -> Points:
        """Total contact moment at the world origin."""
        return self.wrench.moment_nm

    @property
    def wrench(self) -> Wrench:
        """Contact wrench at the world origin."""
        return contact_wrench(self.com_m, self.acceleration_m_s2, self.momentum_rate_nm, self.mass_kg)


def true_motion(body: AnthropometricBody, posture: BSpline, time_s: Series) -> TrueMotion:
    """Evaluate the motion ``posture`` (34 coordinates over time) at the instants ``time_s``."""
    q, v, a = (np.ascontiguousarray(posture(time_s, nu=order)) for order in range(3))
    return motion_truth(body.model, time_s, q, v, a)


def motion_truth(
    model: pin.Model,
    time_s: Series,
    q: Float[np.ndarray, "n nq"],
    v: Float[np.ndarray, "n nv"],
    a: Float[np.ndarray, "n nv"],
) -> TrueMotion:
    """Mechanics of a motion given by configurations, velocities and accelerations of ``model``."""
    data, m, n = model.createData(), float(pin.computeTotalMass(model)), len(time_s)
    com, momentum, rate = np.empty((n, 3)), np.empty((n, 6)), np.empty((n, 6))
    for k in range(n):
        pin.computeCentroidalMomentumTimeVariation(model, data, q[k], v[k], a[k])
        com[k], momentum[k], rate[k] = data.com[0], data.hg.vector, data.dhg.vector
    return TrueMotion(
        time_s,
        m,
        com,
        momentum[:, :3] / m,
        rate[:, :3] / m,
        np.ascontiguousarray(momentum[:, 3:]),
        np.ascontiguousarray(rate[:, 3:]),
    )
