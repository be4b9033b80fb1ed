"""Centroidal dynamics as a linear system, by the momentum about a fixed point instead of about the CoM.

With ``K = L_c + m c x c'`` (momentum about a fixed point o; all positions are relative to o) the bilinear (4.2b), and
with it all of (4.2), becomes linear, for point forces (4.4) as well as for their wrench (4.5):

    c'' = F + g,     K' = T + c x g,     F = sum f / m,   T = sum p x f / m

in units of mass. Forces constant over an interval h integrate in closed form, exactly:

    c+ = c + h c' + h^2/2 (F + g)
    c'+ = c' + h (F + g)
    K+ = K + h T + (h c + h^2/2 c' + h^3/6 F) x g                               (g x g = 0)

The bilinear term remains only in the mean rate of L_c over the interval, which enters the cost:

    (L_c+ - L_c) / h = T - (c + h/2 c' + h^2/6 g) x F                           (F x F = 0)

All forces are divided by |g|: F = (0, 0, 1) balances gravity.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from stridelab.conventions import GRAVITY_M_S2, Rotation, Vector3

N_STATE = 9
"""Size of ``x = (c, c', K)``, K in units of m |g|."""
N_WRENCH = 6
"""Size of ``(F, T)``, in units of m |g| and of m |g| times a metre."""

DOWN = np.array([0.0, 0.0, -1.0])


def skew(a: Vector3) -> Rotation:
    """Matrix of ``b -> a x b``."""
    x, y, z = a
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


@dataclass(frozen=True, eq=False)
class Step:
    """``x+ = A x + B (F, T) + b`` over one interval."""

    A: Float[np.ndarray, "9 9"]
    B: Float[np.ndarray, "9 6"]
    b: Float[np.ndarray, "9"]


def discrete_step(h: float) -> Step:
    """Exact step over ``h`` seconds with a constant contact wrench."""
    G = GRAVITY_M_S2
    E, cross_g = np.eye(3), -skew(DOWN)  # a x g = -[g]x a
    A, B, b = np.eye(N_STATE), np.zeros((N_STATE, N_WRENCH)), np.zeros(N_STATE)
    A[0:3, 3:6] = h * E
    A[6:9, 0:3], A[6:9, 3:6] = h * cross_g, h**2 / 2 * cross_g
    B[0:3, 0:3], B[3:6, 0:3] = h**2 / 2 * G * E, h * G * E
    B[6:9, 0:3], B[6:9, 3:6] = h**3 / 6 * G * cross_g, h * E
    b[0:3], b[3:6] = h**2 / 2 * G * DOWN, h * G * DOWN
    return Step(A, B, b)
