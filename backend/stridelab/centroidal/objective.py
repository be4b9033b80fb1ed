"""The objective in CasADi: value, gradient and curvature.

The curvature is that of Gauss and Newton for the squares (their residual, the rate of L_c, is nearly zero) and that of
``likelihood`` for the log-densities. Each part is one small function, mapped over the intervals or nodes and scattered
into place, so that building takes milliseconds per second of motion where differentiating one large expression takes
seconds.
"""

from dataclasses import dataclass
from functools import cache

import casadi as ca
import numpy as np
import scipy.sparse as sp

from stridelab.centroidal.cone import N_RAYS, rays
from stridelab.centroidal.dynamics import DOWN
from stridelab.centroidal.layout import Layout
from stridelab.centroidal.likelihood import likelihood
from stridelab.centroidal.problem import CentroidalProblem, Grid
from stridelab.centroidal.sparse import Blocks, Triangle, constant, scatter
from stridelab.conventions import GRAVITY_M_S2, Series, Vector3
from stridelab.dynamics.placement import Placement

SCALE = 1e-2
"""Brings the objective's gradient near that of the constraints."""


@dataclass(frozen=True, eq=False)
class Objective:
    """CasADi functions of ``w``, all times ``SCALE``: ``value``, ``gradient``, upper triangle of the ``curvature``.

    ``curvature`` takes the theta of ``likelihood`` as its second argument.
    """

    value: ca.Function
    gradient: ca.Function
    curvature: ca.Function


@dataclass(frozen=True, eq=False)
class Visit:
    """A node at which an effector touches, its proxy's frame, and the seconds of the integral that it stands for."""

    node: int
    frame: Placement
    seconds: float


def objective(problem: CentroidalProblem, grid: Grid, layout: Layout, origin_m: Vector3) -> Objective:
    """(4.20a) with our regularisers, positions in ``w`` relative to ``origin_m``."""
    w, theta = ca.MX.sym("w", layout.n), ca.MX.sym("theta")
    H = Triangle()

    Q = _force_weights(problem, grid, layout)
    Qw = constant(Q) @ w
    value, gradient = 0.5 * ca.dot(w, Qw), Qw
    H.add_constant(Q)

    N, weights = len(grid.step_s), problem.weights
    of_y = np.hstack([layout.state[:-1, None] + np.arange(6), layout.wrench[:, None] + np.arange(6)])
    Y = ca.reshape(w[of_y.ravel().tolist()], 12, N)
    parameters = np.empty((3, N))
    parameters[0] = grid.step_s
    parameters[1:] = [[weights.com_acceleration], [weights.momentum_rate * problem.weight_n**2]]
    squares, slope, curvature = (function.map(N) for function in _squares())
    value += ca.sum2(squares(Y, parameters))
    gradient += scatter(of_y, layout.n) @ ca.vec(slope(Y, parameters))
    H.add_blocks(of_y, curvature(Y, parameters))

    for name in problem.sequence.effectors:
        if name not in problem.proxies:
            continue
        touched = visits(problem, grid, name)
        M = len(touched)
        of_c = layout.state[[visit.node for visit in touched], None] + np.arange(3)
        C = ca.reshape(w[of_c.ravel().tolist()], 3, M)
        p = np.array([visit.frame.position_m - origin_m for visit in touched]).T
        R = np.array([visit.frame.rotation.ravel(order="F") for visit in touched]).T
        seconds = weights.likelihood * np.array([[visit.seconds for visit in touched]])
        part = likelihood(problem.proxies[name].mixture)
        value += ca.dot(seconds, part.value.map(M)(C, p, R))
        gradient += scatter(of_c, layout.n) @ ca.vec(part.gradient.map(M)(C, p, R) * np.repeat(seconds, 3, axis=0))
        H.add_blocks(of_c, part.curvature.map(M)(C, p, R, theta) * np.kron(seconds, np.ones((3, 3))))

    return Objective(
        ca.Function("value", [w], [SCALE * value]),
        ca.Function("gradient", [w], [ca.densify(SCALE * gradient)]),
        ca.Function("curvature", [w, theta], [SCALE * H.matrix(layout.n)]),
    )


def visits(problem: CentroidalProblem, grid: Grid, effector: str) -> list[Visit]:
    """Where the log-density of ``effector`` is evaluated: trapezoidal rule over every interval in which it touches.

    A node between two phases counts half for the contacts of each.
    """
    found: list[Visit] = []
    for i, phase in enumerate(problem.sequence.phases):
        if effector not in phase.contacts:
            continue
        intervals = np.flatnonzero(grid.phase == i)
        seconds: Series = np.zeros(len(intervals) + 1)
        seconds[:-1] += grid.step_s[intervals] / 2
        seconds[1:] += grid.step_s[intervals] / 2
        first, heading_rad = int(intervals[0]), float(problem.sequence.headings_rad[i])
        frame = problem.proxies[effector].placement(phase.contacts[effector].placement, heading_rad)
        found += [Visit(first + k, frame, float(s)) for k, s in enumerate(seconds)]
    return found


@cache
def _squares() -> tuple[ca.Function, ca.Function, ca.Function]:
    """Squares of one interval as functions of ``y = (c, c', F, T)`` and ``(h, w_c, w_L (m |g|)^2)``; Gauss-Newton.

    r = (sqrt(2 h w_c) c'', sqrt(2 h w_L) (L_c+ - L_c) / h),   value |r|^2 / 2, gradient J^T r, curvature J^T J
    """
    y, parameters = ca.SX.sym("y", 12), ca.SX.sym("parameters", 3)
    c, v, F, T = y[0:3], y[3:6], y[6:9], y[9:12]
    h, w_c, w_L = parameters[0], parameters[1], parameters[2]
    G, down = GRAVITY_M_S2, ca.DM(DOWN)
    acceleration = G * (F + down)
    momentum_rate = T - ca.cross(c + h / 2 * v + h**2 / 6 * G * down, F)
    r = ca.vertcat(ca.sqrt(2 * h * w_c) * acceleration, ca.sqrt(2 * h * w_L) * momentum_rate)
    J = ca.jacobian(r, y)
    return (
        ca.Function("squares", [y, parameters], [0.5 * ca.sumsqr(r)]),
        ca.Function("squares_gradient", [y, parameters], [J.T @ r]),
        ca.Function("squares_curvature", [y, parameters], [ca.densify(J.T @ J)]),
    )


def _force_weights(problem: CentroidalProblem, grid: Grid, layout: Layout) -> sp.csc_matrix:
    """``Q`` of the regulariser ``w^T Q w / 2 = sum h weight |f / (m g)|^2``."""
    Q = Blocks()
    for name, starts in layout.ray.items():
        for k, start in starts.items():
            V = rays(problem.contact(name, int(grid.phase[k])).friction)
            block = 2 * float(grid.step_s[k]) * problem.force_weight(name) * (V.T @ V)
            for i in range(len(problem.points_m(name))):
                Q.add(start + N_RAYS * i, start + N_RAYS * i, block)
    return Q.matrix((layout.n, layout.n))
