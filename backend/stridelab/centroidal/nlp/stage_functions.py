"""The small functions of which the programme consists, in CasADi: one interval, one group or one node each.

    gap       x+ - A(h) x - B(h) (F, T) - b(h)                                       (4.8), exact (``dynamics``)
    tie       (F, T) - sum of G u,     with a contact moved by d:  T - d x (forces)  (4.2)
    cone      eta^2 - |tau|^2,  scaled                                               (4.20c)
    squares   h w_c |c''|^2 + h w_L |(L_c+ - L_c) / h - r|^2,   r = 0 in             (4.20a)
    effort    h u^T Q u / 2

The length of an interval is ``h = q_0``, or ``h = q_0 T_s`` where the duration of its phase is a variable, the last
entry of y. Squares then have their true second derivatives, otherwise those of Gauss and Newton.
"""

from dataclasses import dataclass
from functools import cache

import casadi as ca

from stridelab.centroidal.dynamics import DOWN, N_STATE, N_WRENCH
from stridelab.centroidal.nlp.density_term import Likelihood
from stridelab.conventions import GRAVITY_M_S2


@dataclass(frozen=True, eq=False)
class CostFunctions:
    """``value``, ``gradient`` of ``(y, q)``, ``curvature`` of ``(y, q, theta)``."""

    value: ca.Function
    gradient: ca.Function
    curvature: ca.Function


@dataclass(frozen=True, eq=False)
class RowFunctions:
    """``value``, ``jacobian`` of ``(y, q)``, ``curvature`` of ``(y, q, lambda)``, None where linear."""

    value: ca.Function
    jacobian: ca.Function
    curvature: ca.Function | None


def row_functions(psi: ca.SX, y: ca.SX, q: ca.SX) -> RowFunctions:
    """``psi(y, q)`` with its derivatives."""
    lam = ca.SX.sym("lambda", psi.numel())
    bend = ca.hessian(ca.dot(lam, psi), y)[0]
    return RowFunctions(
        ca.Function("rows", [y, q], [ca.densify(psi)]),
        ca.Function("rows_jacobian", [y, q], [ca.jacobian(psi, y)]),
        ca.Function("rows_curvature", [y, q, lam], [bend]) if bend.nnz() else None,
    )


def cost_functions(phi: ca.SX, y: ca.SX, q: ca.SX, curvature: ca.SX) -> CostFunctions:
    """``phi(y, q)`` with its gradient and what is taken for its curvature."""
    return CostFunctions(
        ca.Function("cost", [y, q], [phi]),
        ca.Function("cost_gradient", [y, q], [ca.densify(ca.gradient(phi, y))]),
        ca.Function("cost_curvature", [y, q, ca.SX.sym("theta")], [curvature]),
    )


def _length(y: ca.SX, q: ca.SX, free: bool) -> ca.SX:
    return q[0] * y[y.numel() - 1] if free else q[0]


def _down_cross(a: ca.SX) -> ca.SX:
    """``a x g / |g|``."""
    return ca.cross(a, ca.DM(DOWN))


@cache
def gap(free: bool) -> RowFunctions:
    """``y = (x, F, T, x+ [, T_s])``, ``q = (h)``."""
    y, q = ca.SX.sym("y", 2 * N_STATE + N_WRENCH + free), ca.SX.sym("q")
    h, G, down = _length(y, q, free), GRAVITY_M_S2, ca.DM(DOWN)
    c, v, K, F, T = (y[3 * i : 3 * i + 3] for i in range(5))
    a = G * (F + down)
    swept = h * c + h**2 / 2 * v + h**3 / 6 * G * F
    ahead = ca.vertcat(c + h * v + h**2 / 2 * a, v + h * a, K + h * T + _down_cross(swept))
    return row_functions(y[15:24] - ahead, y, q)


@cache
def tie(size: int, moving: bool) -> RowFunctions:
    """``y = (u [, d])``, ``q = G`` column by column, and for a displacement d the axes x and y of the contact."""
    y, q = ca.SX.sym("y", size + 2 * moving), ca.SX.sym("q", 6 * size + 6 * moving)
    wrench = ca.reshape(q[: 6 * size], 6, size) @ y[:size]
    if moving:
        d = ca.reshape(q[6 * size :], 3, 2) @ y[size:]
        wrench = wrench + ca.vertcat(ca.SX(3, 1), ca.cross(d, wrench[:3]))
    return row_functions(-wrench, y, q)


@cache
def same(size: int) -> RowFunctions:
    """``y``, as it is."""
    y = ca.SX.sym("y", size)
    return row_functions(y, y, ca.SX.sym("q", 0))


@cache
def dot(size: int) -> RowFunctions:
    """``q y``."""
    y, q = ca.SX.sym("y", size), ca.SX.sym("q", size)
    return row_functions(ca.dot(q, y), y, q)


@cache
def momentum() -> RowFunctions:
    """``L_c`` of ``y = (c, c', K)``, in units of m |g|."""
    y = ca.SX.sym("y", N_STATE)
    return row_functions(y[6:9] - ca.cross(y[0:3], y[3:6]) / GRAVITY_M_S2, y, ca.SX.sym("q", 0))


@cache
def cone(size: int) -> RowFunctions:
    """``(eta^2 - |tau|^2) / 2`` of ``y = (tau, eta)`` with ``size`` entries of tau."""
    y = ca.SX.sym("y", size + 1)
    return row_functions(0.5 * (y[size] ** 2 - ca.sumsqr(y[:size])), y, ca.SX.sym("q", 0))


@cache
def squares(free: bool) -> CostFunctions:
    """``y = (c, c', F, T [, T_s])``, ``q = (h, w_c, w_L (m |g|)^2, r / (m |g|))``: ``|e|^2 / 2``.

    e = (sqrt(2 h w_c) c'', sqrt(2 h w_L) ((L_c+ - L_c) / h - r)).
    """
    y, q = ca.SX.sym("y", 12 + free), ca.SX.sym("q", 6)
    c, v, F, T = (y[3 * i : 3 * i + 3] for i in range(4))
    h, G, down = _length(y, q, free), GRAVITY_M_S2, ca.DM(DOWN)
    acceleration = G * (F + down)
    momentum_rate = T - ca.cross(c + h / 2 * v + h**2 / 6 * G * down, F) - q[3:6]
    phi = h * (q[1] * ca.sumsqr(acceleration) + q[2] * ca.sumsqr(momentum_rate))
    if free:
        return cost_functions(phi, y, q, ca.hessian(phi, y)[0])
    J = ca.jacobian(ca.vertcat(ca.sqrt(2 * h * q[1]) * acceleration, ca.sqrt(2 * h * q[2]) * momentum_rate), y)
    return cost_functions(phi, y, q, ca.densify(J.T @ J))


@cache
def effort(size: int, free: bool) -> CostFunctions:
    """``y = (u [, T_s])``, ``q = (h, Q)`` with Q column by column."""
    y, q = ca.SX.sym("y", size + free), ca.SX.sym("q", 1 + size**2)
    Q = ca.reshape(q[1:], size, size)
    phi = 0.5 * _length(y, q, free) * ca.bilin(Q, y[:size], y[:size])
    return cost_functions(phi, y, q, ca.hessian(phi, y)[0] if free else q[0] * Q)


def density(mixture: Likelihood, free: bool, moving: bool) -> CostFunctions:
    """``-h log p``: ``y = (c [, d] [, T_s])``, ``q = (h, p, R, axes of d)``; R and axes column by column."""
    y, q = ca.SX.sym("y", 3 + 2 * moving + free), ca.SX.sym("q", 13 + 6 * moving)
    theta = ca.SX.sym("theta")
    place, R = q[1:4], q[4:13]
    onto = ca.SX.eye(3)
    if moving:
        axes = ca.reshape(q[13:], 3, 2)
        place = place + axes @ y[3:5]
        onto = ca.horzcat(onto, -axes)
    h, at = _length(y, q, free), (y[:3], place, R)
    slope, bend = mixture.gradient(*at), h * onto.T @ mixture.curvature(*at, theta) @ onto
    gradient = h * onto.T @ slope
    if free:
        across = q[0] * onto.T @ slope
        gradient = ca.vertcat(gradient, q[0] * mixture.value(*at))
        bend = ca.blockcat([[bend, across], [across.T, ca.SX(1, 1)]])
    return CostFunctions(
        ca.Function("cost", [y, q], [h * mixture.value(*at)]),
        ca.Function("cost_gradient", [y, q], [ca.densify(gradient)]),
        ca.Function("cost_curvature", [y, q, theta], [bend]),
    )


@cache
def price() -> CostFunctions:
    """``q T_s``."""
    y, q = ca.SX.sym("y"), ca.SX.sym("q")
    return cost_functions(q * y, y, q, ca.SX(1, 1))
