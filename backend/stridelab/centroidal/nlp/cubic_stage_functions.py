"""CasADi functions of one interval whose wrench is a cubic spline: dynamics and squared rates.

With F and T in Bernstein form (``force_splines``), B'_i, B''_i, B'''_i its integrals from 0 to 1,

    c'+ = c' + h sum B'_i F_i + h g,      c+ = c + h c' + h^2 sum B''_i F_i + h^2/2 g
    K+ = K + h sum B'_i T_i + (h c + h^2/2 c' + h^3 sum B'''_i F_i) x g                      (4.8), exact
    squares    h sum over Gauss points of  w (w_c |c'' - a|^2 + w_L |T - c x F - r|^2)       (4.20a)

r is the momentum rate of the limbs around each of the points, a the reference acceleration.
The four-point rule is exact for the first square (degree 6) and not for the second (degree 16 in t), whose integrand
is almost zero. The outer control points follow from ``junction_weights``: y holds the inner point before the interval,
(x, F_1, T_1, F_2, T_2), x+, and the inner point after it.
"""

from functools import cache

import casadi as ca

from stridelab.centroidal.contact_wrench import DOWN, N_STATE, N_WRENCH
from stridelab.centroidal.force_splines import N_GAUSS, bernstein_weights, gauss_rule
from stridelab.centroidal.nlp.stage_functions import CostFunctions, RowFunctions, cost_functions, row_functions
from stridelab.conventions import GRAVITY_M_S2


def _control_points(y: ca.SX, at: int, last: bool, first: bool, own: ca.SX) -> list[ca.SX]:
    """The four control points ``(F, T)``: the inner ones at ``at``, the neighbours' at the ends of y."""
    one, two = y[at : at + N_WRENCH], y[at + N_WRENCH : at + 2 * N_WRENCH]
    begin = one if first else own[0] * one + (1 - own[0]) * y[:N_WRENCH]
    end = two if last else own[1] * two + (1 - own[1]) * y[y.numel() - N_WRENCH :]
    return [begin, one, two, end]


def _weighted_sum(at: float, integrals: int, points: list[ca.SX]) -> ca.SX:
    return ca.horzcat(*points) @ ca.DM(bernstein_weights(at)[integrals])


@cache
def dynamics_gap(first: bool, last: bool) -> RowFunctions:
    """Dynamics residual of an interval; ``q = (h, own weights in both ends)``."""
    before, after = (0 if first else N_WRENCH), (0 if last else N_WRENCH)
    y, q = ca.SX.sym("y", before + 2 * N_STATE + 2 * N_WRENCH + after), ca.SX.sym("q", 3)
    h, G, down = q[0], GRAVITY_M_S2, ca.DM(DOWN)
    c, v, K = (y[before + 3 * i : before + 3 * i + 3] for i in range(3))
    f = _control_points(y, before + N_STATE, last, first, q[1:])
    at = before + N_STATE + 2 * N_WRENCH
    first_integral, second_integral, third_integral = (_weighted_sum(1.0, n, f) for n in (1, 2, 3))
    com_integral = h * c + h**2 / 2 * v + h**3 * G * third_integral[:3]
    next_state = ca.vertcat(
        c + h * v + h**2 * G * (second_integral[:3] + down / 2),
        v + h * G * (first_integral[:3] + down),
        K + h * first_integral[3:] + ca.cross(com_integral, down),
    )
    return row_functions(y[at : at + N_STATE] - next_state, y, q)


@cache
def squared_rates(first: bool, last: bool) -> CostFunctions:
    """Squared rates with Gauss-Newton Hessian; y has no K and x+.

    ``q = (h, own weights in both ends, w_c, w_L (m |g|)^2, r / (m |g|), a)``, r and a for every Gauss point.
    """
    before, after = (0 if first else N_WRENCH), (0 if last else N_WRENCH)
    y, q = ca.SX.sym("y", before + 6 + 2 * N_WRENCH + after), ca.SX.sym("q", 5 + 6 * N_GAUSS)
    h, G, down = q[0], GRAVITY_M_S2, ca.DM(DOWN)
    c, v = (y[before + 3 * i : before + 3 * i + 3] for i in range(2))
    f = _control_points(y, before + 6, last, first, q[1:3])
    parts = []
    for k, (s, w) in enumerate(gauss_rule(N_GAUSS)):
        F, T = ca.vertsplit(_weighted_sum(s, 0, f), 3)
        com = c + h * s * v + h**2 * G * (_weighted_sum(s, 2, f)[:3] + s**2 / 2 * down)
        l_rate = T - ca.cross(com, F) - q[5 + 3 * k : 8 + 3 * k]
        at = 5 + 3 * (N_GAUSS + k)
        acceleration = G * (F + down) - q[at : at + 3]
        parts += [ca.sqrt(2 * h * w * q[3]) * acceleration, ca.sqrt(2 * h * w * q[4]) * l_rate]
    r = ca.vertcat(*parts)
    J = ca.jacobian(r, y)
    return cost_functions(ca.sumsqr(r) / 2, y, q, ca.densify(J.T @ J))
