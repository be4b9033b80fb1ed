"""CasADi functions that make up the nonlinear program, each for one interval, one group or one node.

    gap       x+ - A(h) x - B(h) (F, T) - b(h)                                       (4.8), exact (``dynamics``)
    tie       (F, T) - sum of G u,     with a contact moved by d:  T - d x (forces)  (4.2)
    cone      eta^2 - |tau|^2,  scaled                                               (4.20c)
    squares   h w_c |c'' - a|^2 + h w_L |(L_c+ - L_c) / h - r|^2,   a = r = 0 in             (4.20a)
    effort    h u^T Q u / 2

The length of an interval is ``h = q_0``, or ``h = q_0 T_s`` where the duration of its phase is a variable, the last
entry of y. Squares then have exact second derivatives, otherwise the Gauss-Newton approximation.

The log-density term of (4.20a) for one effector, in CasADi: value, gradient and two curvatures.

With y = R^T (c - p) the CoM in the contact frame, the responsibilities gamma_j and the scores d_j of the components

    p(y) = sum_j w_j N(y; mu_j, S_j),    gamma_j = w_j N_j / p,    d_j = S_j^-1 (y - mu_j)
    -d/dy log p = sum_j gamma_j d_j
    -d2/dy2 log p = sum_j gamma_j S_j^-1 - theta Cov_gamma(d)

theta = 1 is the second derivative, indefinite between and beyond the components; theta = 0 leaves the EM majoriser, an
upper bound that is always positive definite but gives short steps between components of similar weight. Which solver
uses which, with measurements, is described in docs/theory/centroidal-problem.md.
"""

from dataclasses import dataclass
from functools import cache

import casadi as ca
import numpy as np

from stridelab.centroidal.contact_wrench import DOWN, N_STATE, N_WRENCH
from stridelab.conventions import GRAVITY_M_S2
from stridelab.reachability.gaussian_mixture import Mixture


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


def likelihood_functions(mixture: Mixture) -> CostFunctions:
    """``-log p`` of one effector's mixture, as functions of ``(c, p, vec R)`` in world coordinates, and of theta."""
    c, p, R, theta = ca.SX.sym("c", 3), ca.SX.sym("p", 3), ca.SX.sym("R", 3, 3), ca.SX.sym("theta")
    y = R.T @ (c - p)
    exponents, scores = [], []
    for w, mu, W in zip(mixture.weights, mixture.means_m, mixture.inverse_cholesky, strict=True):
        W_low = ca.sparsify(ca.DM(W))  # lower triangular
        whitened = W_low @ (y - ca.DM(mu))
        constant = np.log(w) + np.log(np.diag(W)).sum() - 1.5 * np.log(2 * np.pi)
        exponents.append(constant - 0.5 * ca.sumsqr(whitened))
        scores.append(W_low.T @ whitened)
    max_exponent = exponents[0]
    for e in exponents[1:]:
        max_exponent = ca.fmax(max_exponent, e)
    logp = max_exponent + ca.log(sum(ca.exp(e - max_exponent) for e in exponents))
    gamma = [ca.exp(e - logp) for e in exponents]
    mean = sum(s * d for s, d in zip(gamma, scores, strict=True))
    majoriser = sum(s * ca.DM(P) for s, P in zip(gamma, mixture.precisions, strict=True))
    covariance = sum(s * (d - mean) @ (d - mean).T for s, d in zip(gamma, scores, strict=True))
    inputs = [c, p, ca.vec(R)]
    return CostFunctions(
        value=ca.Function("value", inputs, [-logp]),
        gradient=ca.Function("gradient", inputs, [R @ mean]),
        curvature=ca.Function("curvature", [*inputs, theta], [R @ (majoriser - theta * covariance) @ R.T]),
    )


def row_functions(psi: ca.SX, y: ca.SX, q: ca.SX) -> RowFunctions:
    """``psi(y, q)`` with its derivatives."""
    lam = ca.SX.sym("lambda", psi.numel())
    curvature = ca.hessian(ca.dot(lam, psi), y)[0]
    return RowFunctions(
        ca.Function("rows", [y, q], [ca.densify(psi)]),
        ca.Function("rows_jacobian", [y, q], [ca.jacobian(psi, y)]),
        ca.Function("rows_curvature", [y, q, lam], [curvature]) if curvature.nnz() else None,
    )


def cost_functions(phi: ca.SX, y: ca.SX, q: ca.SX, curvature: ca.SX) -> CostFunctions:
    """``phi(y, q)`` with its gradient and the given Hessian (approximation)."""
    return CostFunctions(
        ca.Function("cost", [y, q], [phi]),
        ca.Function("cost_gradient", [y, q], [ca.densify(ca.gradient(phi, y))]),
        ca.Function("cost_curvature", [y, q, ca.SX.sym("theta")], [curvature]),
    )


def _interval_length(y: ca.SX, q: ca.SX, free: bool) -> ca.SX:
    return q[0] * y[y.numel() - 1] if free else q[0]


def _down_cross(a: ca.SX) -> ca.SX:
    """``a x g / |g|``."""
    return ca.cross(a, ca.DM(DOWN))


@cache
def dynamics_gap(free: bool) -> RowFunctions:
    """Dynamics residual of an interval: ``y = (x, F, T, x+ [, T_s])``, ``q = (h)``."""
    y, q = ca.SX.sym("y", 2 * N_STATE + N_WRENCH + free), ca.SX.sym("q")
    h, G, down = _interval_length(y, q, free), GRAVITY_M_S2, ca.DM(DOWN)
    c, v, K, F, T = (y[3 * i : 3 * i + 3] for i in range(5))
    a = G * (F + down)
    com_integral = h * c + h**2 / 2 * v + h**3 / 6 * G * F
    next_state = ca.vertcat(c + h * v + h**2 / 2 * a, v + h * a, K + h * T + _down_cross(com_integral))
    return row_functions(y[15:24] - next_state, y, q)


@cache
def wrench_tie(size: int, moving: bool) -> RowFunctions:
    """``-G u``: ``y = (u [, d])``, ``q = G`` by columns, and for a displacement d the axes x and y of the contact."""
    y, q = ca.SX.sym("y", size + 2 * moving), ca.SX.sym("q", 6 * size + 6 * moving)
    wrench = ca.reshape(q[: 6 * size], 6, size) @ y[:size]
    if moving:
        d = ca.reshape(q[6 * size :], 3, 2) @ y[size:]
        wrench = wrench + ca.vertcat(ca.SX(3, 1), ca.cross(d, wrench[:3]))
    return row_functions(-wrench, y, q)


@cache
def identity_rows(size: int) -> RowFunctions:
    """``y`` itself."""
    y = ca.SX.sym("y", size)
    return row_functions(y, y, ca.SX.sym("q", 0))


@cache
def dot_product(size: int) -> RowFunctions:
    """``q y``."""
    y, q = ca.SX.sym("y", size), ca.SX.sym("q", size)
    return row_functions(ca.dot(q, y), y, q)


@cache
def momentum_about_com() -> RowFunctions:
    """``L_c`` of ``y = (c, c', K)``, in units of m |g|."""
    y = ca.SX.sym("y", N_STATE)
    return row_functions(y[6:9] - ca.cross(y[0:3], y[3:6]) / GRAVITY_M_S2, y, ca.SX.sym("q", 0))


@cache
def cone_row(size: int) -> RowFunctions:
    """``(eta^2 - |tau|^2) / 2`` of ``y = (tau, eta)`` with ``size`` entries of tau."""
    y = ca.SX.sym("y", size + 1)
    return row_functions(0.5 * (y[size] ** 2 - ca.sumsqr(y[:size])), y, ca.SX.sym("q", 0))


@cache
def squared_rates(free: bool) -> CostFunctions:
    """``y = (c, c', F, T [, T_s])``, ``q = (h, w_c, w_L (m |g|)^2, r / (m |g|), a)``: ``|e|^2 / 2``.

    e = (sqrt(2 h w_c) (c'' - a), sqrt(2 h w_L) ((L_c+ - L_c) / h - r)).
    """
    y, q = ca.SX.sym("y", 12 + free), ca.SX.sym("q", 9)
    c, v, F, T = (y[3 * i : 3 * i + 3] for i in range(4))
    h, G, down = _interval_length(y, q, free), GRAVITY_M_S2, ca.DM(DOWN)
    # Free durations allow no reference, and ipopt's path depends on every rounding.
    acceleration = G * (F + down) if free else G * (F + down) - q[6:9]
    momentum_rate = T - ca.cross(c + h / 2 * v + h**2 / 6 * G * down, F) - q[3:6]
    phi = h * (q[1] * ca.sumsqr(acceleration) + q[2] * ca.sumsqr(momentum_rate))
    if free:
        return cost_functions(phi, y, q, ca.hessian(phi, y)[0])
    J = ca.jacobian(ca.vertcat(ca.sqrt(2 * h * q[1]) * acceleration, ca.sqrt(2 * h * q[2]) * momentum_rate), y)
    return cost_functions(phi, y, q, ca.densify(J.T @ J))


@cache
def state_density_cost() -> CostFunctions:
    """(4.11): ``y = (c, c', K, F, T)``, ``q = (h, A_0, b_0, A_1, b_1, d)`` with the matrices by columns.

    h (z_0^T A_0 z_0 / 2 - b_0^T z_0 + z_1^T A_1 z_1 / 2 - b_1^T z_1 + d) with z_0 = (c', L_c / (m |g|)) at the first
    node and z_1 the mean of (c'', L_c' / (m |g|)), as in ``squared_rates``; Gauss-Newton approximation of the Hessian.
    """
    y, q = ca.SX.sym("y", 15), ca.SX.sym("q", 86)
    c, v, K, F, T = (y[3 * i : 3 * i + 3] for i in range(5))
    h, down = q[0], ca.DM(DOWN)
    momentum_rate = T - ca.cross(c + h / 2 * v + h**2 / 6 * GRAVITY_M_S2 * down, F)
    z = (
        ca.vertcat(v, K - ca.cross(c, v) / GRAVITY_M_S2),
        ca.vertcat(GRAVITY_M_S2 * (F + down), momentum_rate),
    )
    phi, curvature = q[85], ca.SX(15, 15)
    for j, z_j in enumerate(z):
        A, b = ca.reshape(q[1 + 42 * j : 37 + 42 * j], 6, 6), q[37 + 42 * j : 43 + 42 * j]
        J = ca.jacobian(z_j, y)
        phi += 0.5 * ca.bilin(A, z_j, z_j) - ca.dot(b, z_j)
        curvature += J.T @ A @ J
    return cost_functions(h * phi, y, q, ca.densify(h * curvature))


@cache
def effort_cost(size: int, free: bool) -> CostFunctions:
    """``h u^T Q u / 2``: ``y = (u [, T_s])``, ``q = (h, Q)`` with Q by columns."""
    y, q = ca.SX.sym("y", size + free), ca.SX.sym("q", 1 + size**2)
    Q = ca.reshape(q[1:], size, size)
    phi = 0.5 * _interval_length(y, q, free) * ca.bilin(Q, y[:size], y[:size])
    return cost_functions(phi, y, q, ca.hessian(phi, y)[0] if free else q[0] * Q)


def density_cost(functions: CostFunctions, free: bool, moving: bool) -> CostFunctions:
    """``-h log p``: ``y = (c [, d] [, T_s])``, ``q = (h, p, R, axes of d)``; R and axes by columns."""
    y, q = ca.SX.sym("y", 3 + 2 * moving + free), ca.SX.sym("q", 13 + 6 * moving)
    theta = ca.SX.sym("theta")
    position, R = q[1:4], q[4:13]
    d_com = ca.SX.eye(3)
    if moving:
        axes = ca.reshape(q[13:], 3, 2)
        position = position + axes @ y[3:5]
        d_com = ca.horzcat(d_com, -axes)
    h, arguments = _interval_length(y, q, free), (y[:3], position, R)
    com_gradient, curvature = (
        functions.gradient(*arguments),
        h * d_com.T @ functions.curvature(*arguments, theta) @ d_com,
    )
    gradient = h * d_com.T @ com_gradient
    if free:
        mixed = q[0] * d_com.T @ com_gradient
        gradient = ca.vertcat(gradient, q[0] * functions.value(*arguments))
        curvature = ca.blockcat([[curvature, mixed], [mixed.T, ca.SX(1, 1)]])
    return CostFunctions(
        ca.Function("cost", [y, q], [h * functions.value(*arguments)]),
        ca.Function("cost_gradient", [y, q], [ca.densify(gradient)]),
        ca.Function("cost_curvature", [y, q, theta], [curvature]),
    )


@cache
def duration_price() -> CostFunctions:
    """``q T_s``."""
    y, q = ca.SX.sym("y"), ca.SX.sym("q")
    return cost_functions(q * y, y, q, ca.SX(1, 1))
