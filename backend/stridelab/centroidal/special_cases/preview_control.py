"""Kajita's preview control of the zero-moment point: the special case of the centroidal problem with a closed form.

With the CoM at a constant height h above level ground and no angular momentum, (4.2) leaves one triple integrator per
horizontal axis whose output is the zero-moment point (2.9), the cart on a table:

    x+ = A x + B u,   p = C x,   x = (c, c', c''),   u = c'''
    A = [1 dt dt^2/2; 0 1 dt; 0 0 1],   B = (dt^3/6, dt^2/2, dt),   C = (1, 0, -h/g)

Kajita et al. (2003) follow a planned ``p_ref`` by minimising over all u, with e = p - p_ref and d the step difference,

    sum_k  Q_e e_k^2 + R (d u_k)^2                                              (their eq. 19, Q_x = 0)

With ``z = (e, d x)`` this is the linear-quadratic problem ``z+ = F z + G du - E dp_ref`` (F = [1 CA; 0 A],
G = (CB, B), E = (1, 0, 0, 0)), whose optimum uses the future reference (Katayama et al. 1985). K solves the discrete
Riccati equation ``K = F'K F - F'K G (R + G'K G)^-1 G'K F + Q``; with ``F_c = F - G (R + G'K G)^-1 G'K F``

    u_k = - G_I sum_{i<=k} e_i - G_x x_k - sum_{j=1..N} G_d(j) p_ref(k+j)
    (G_I, G_x) = (R + G'K G)^-1 G'K F,   G_d(j) = -(R + G'K G)^-1 G' (F_c')^(j-1) K E

Unlike (4.20), the model has no friction, height, angular momentum or non-coplanar contacts. ``G_d`` decays like
``exp(-sqrt(g/h) t)``: references beyond two seconds have no effect.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float
from scipy.linalg import solve_discrete_are

from stridelab.conventions import GRAVITY_M_S2
from stridelab.errors import Fault, InvalidInput

Plane = Float[np.ndarray, "n 2"]
"""Points of the level ground, one per sample."""


@dataclass(frozen=True, eq=False)
class CartTable:
    """Horizontal motion of the CoM and its zero-moment point in the cart-table model (2.9)."""

    com_m: Plane
    velocity_m_s: Plane
    acceleration_m_s2: Plane
    zmp_m: Plane


@dataclass(frozen=True, eq=False)
class Gains:
    """``integral`` G_I, ``state`` G_x, ``preview`` G_d(1..N), and the solution ``riccati`` K of the DARE."""

    integral: float
    state: Float[np.ndarray, "3"]
    preview: Float[np.ndarray, "N"]
    riccati: Float[np.ndarray, "4 4"]


@dataclass(frozen=True, kw_only=True)
class PreviewControl:
    """Preview controller for a CoM ``height_m`` above the ground, sampled every ``dt_s``.

    ``tracking_weight`` is Q_e and ``effort_weight`` R (Kajita's 1 and 1e-6). Raises ``InvalidInput``
    (``preview-invalid``) if a parameter is not positive or the horizon is shorter than a sample.
    """

    height_m: float
    dt_s: float = 0.005
    horizon_s: float = 2.0
    tracking_weight: float = 1.0
    effort_weight: float = 1e-6

    def __post_init__(self) -> None:
        for name in ("height_m", "dt_s", "horizon_s", "tracking_weight", "effort_weight"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0.0):
                message = f"{name} must be positive, not {value:g}."
                raise InvalidInput("preview-invalid", message, [Fault(name, message)])
        if self.horizon_s < self.dt_s:
            message = "The preview horizon must contain at least one sample."
            raise InvalidInput("preview-invalid", message, [Fault("horizon_s", message)])

    @property
    def model(self) -> tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
        """``A``, ``B`` and ``C`` of the cart-table model."""
        dt = self.dt_s
        A = np.array([[1.0, dt, dt * dt / 2.0], [0.0, 1.0, dt], [0.0, 0.0, 1.0]])
        B = np.array([dt**3 / 6.0, dt * dt / 2.0, dt])
        return A, B, np.array([1.0, 0.0, -self.height_m / GRAVITY_M_S2])

    @cached_property
    def gains(self) -> Gains:
        """Gains of the control law in the module docstring."""
        A, B, C = self.model
        F = np.block([[np.ones((1, 1)), (C @ A)[None]], [np.zeros((3, 1)), A]])
        G = np.concatenate([[C @ B], B])[:, None]
        E = np.array([1.0, 0.0, 0.0, 0.0])
        R = np.array([[self.effort_weight]])
        K = solve_discrete_are(F, G, self.tracking_weight * np.outer(E, E), R)
        inverse = 1.0 / (self.effort_weight + (G.T @ K @ G).item())
        feedback = inverse * (G.T @ K @ F)[0]
        F_c = F - G @ feedback[None]
        preview, X = np.empty(round(self.horizon_s / self.dt_s)), K @ E
        for j in range(len(preview)):
            preview[j] = -inverse * (G[:, 0] @ X)
            X = F_c.T @ X
        return Gains(float(feedback[0]), feedback[1:], preview, K)

    def follow(self, zmp_m: Plane) -> CartTable:
        """Motion whose zero-moment point follows ``zmp_m``, one point per ``dt_s``; starts at rest over the first.

        The reference is extended by its last point.
        """
        A, B, C = self.model
        gains, n = self.gains, len(zmp_m)
        reference = zmp_m - zmp_m[0]
        padded = np.vstack([reference, np.repeat(reference[-1:], len(gains.preview), axis=0)])
        preview = np.column_stack([np.convolve(track, gains.preview[::-1], "valid")[1:] for track in padded.T])
        states, zmp = np.empty((n, 3, 2)), np.empty((n, 2))
        x, total_error = np.zeros((3, 2)), np.zeros(2)
        for k in range(n):
            p = C @ x
            total_error += p - reference[k]
            states[k], zmp[k] = x, p
            u = -gains.integral * total_error - gains.state @ x - preview[k]
            x = A @ x + B[:, None] * u
        return CartTable(states[:, 0] + zmp_m[0], states[:, 1], states[:, 2], zmp + zmp_m[0])
