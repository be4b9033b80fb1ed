"""The small functions of an interval whose wrench is a cubic spline: dynamics and squares, in CasADi.

With F and T in Bernstein's form (``spline``), B'_i, B''_i, B'''_i its integrals from 0 to 1,

    c'+ = c' + h sum B'_i F_i + h g,      c+ = c + h c' + h^2 sum B''_i F_i + h^2/2 g
    K+ = K + h sum B'_i T_i + (h c + h^2/2 c' + h^3 sum B'''_i F_i) x g                      (4.8), exact
    squares    h sum over Gauss' points of  w (w_c |c''|^2 + w_L |T - c x F - r|^2)          (4.20a)

r is the rate of momentum that the limbs take around each of the points.
The rule of four points is exact for the first square (degree 6) and not for the second (degree 16 in t), whose
integrand is all but zero. The outer control points are those of ``spline.joints``: y holds the inner point before the
interval, (x, F_1, T_1, F_2, T_2), x+, and the inner point after it.
"""

from functools import cache

import casadi as ca

from stridelab.centroidal.dynamics import DOWN, N_STATE, N_WRENCH
from stridelab.centroidal.force_splines import N_GAUSS, gauss, weights
from stridelab.centroidal.nlp.stage_functions import CostFunctions, RowFunctions, cost_functions, row_functions
from stridelab.conventions import GRAVITY_M_S2


def _controls(y: ca.SX, at: int, last: bool, first: bool, own: ca.SX) -> list[ca.SX]:
    """The four control points ``(F, T)``: the inner ones at ``at``, the neighbours' at the ends of y."""
    one, two = y[at : at + N_WRENCH], y[at + N_WRENCH : at + 2 * N_WRENCH]
    begin = one if first else own[0] * one + (1 - own[0]) * y[:N_WRENCH]
    end = two if last else own[1] * two + (1 - own[1]) * y[y.numel() - N_WRENCH :]
    return [begin, one, two, end]


def _sum(at: float, integrals: int, points: list[ca.SX]) -> ca.SX:
    return ca.horzcat(*points) @ ca.DM(weights(at)[integrals])


@cache
def gap(first: bool, last: bool) -> RowFunctions:
    """``q = (h, own weights in both ends)``."""
    before, after = (0 if first else N_WRENCH), (0 if last else N_WRENCH)
    y, q = ca.SX.sym("y", before + 2 * N_STATE + 2 * N_WRENCH + after), ca.SX.sym("q", 3)
    h, G, down = q[0], GRAVITY_M_S2, ca.DM(DOWN)
    c, v, K = (y[before + 3 * i : before + 3 * i + 3] for i in range(3))
    f = _controls(y, before + N_STATE, last, first, q[1:])
    at = before + N_STATE + 2 * N_WRENCH
    once, twice, thrice = (_sum(1.0, n, f) for n in (1, 2, 3))
    swept = h * c + h**2 / 2 * v + h**3 * G * thrice[:3]
    ahead = ca.vertcat(
        c + h * v + h**2 * G * (twice[:3] + down / 2),
        v + h * G * (once[:3] + down),
        K + h * once[3:] + ca.cross(swept, down),
    )
    return row_functions(y[at : at + N_STATE] - ahead, y, q)


@cache
def squares(first: bool, last: bool) -> CostFunctions:
    """Without K and x+ in y; ``q = (h, own weights in both ends, w_c, w_L (m |g|)^2, r / (m |g|))``; Gauss-Newton."""
    before, after = (0 if first else N_WRENCH), (0 if last else N_WRENCH)
    y, q = ca.SX.sym("y", before + 6 + 2 * N_WRENCH + after), ca.SX.sym("q", 5 + 3 * N_GAUSS)
    h, G, down = q[0], GRAVITY_M_S2, ca.DM(DOWN)
    c, v = (y[before + 3 * i : before + 3 * i + 3] for i in range(2))
    f = _controls(y, before + 6, last, first, q[1:3])
    parts = []
    for k, (s, w) in enumerate(gauss(N_GAUSS)):
        F, T = ca.vertsplit(_sum(s, 0, f), 3)
        there = c + h * s * v + h**2 * G * (_sum(s, 2, f)[:3] + s**2 / 2 * down)
        l_rate = T - ca.cross(there, F) - q[5 + 3 * k : 8 + 3 * k]
        parts += [ca.sqrt(2 * h * w * q[3]) * G * (F + down), ca.sqrt(2 * h * w * q[4]) * l_rate]
    r = ca.vertcat(*parts)
    J = ca.jacobian(r, y)
    return cost_functions(ca.sumsqr(r) / 2, y, q, ca.densify(J.T @ J))
