"""Loewner and John ellipsoids: the smallest around points and the largest inside a polytope.

    around:  min -log det Q   with  |Q p_i - b| <= 1                         (4.19)
    inside:  max  log det E   with  |E^T a_i| + a_i c <= b_i,   E lower triangular

Both problems are convex (Boyd & Vandenberghe, 8.4). The unknowns are a vector and the triangle of a matrix, 20 numbers
in five dimensions, so the cost of a Newton step depends on the number of facets only through sums over them.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float

from stridelab.contacts.barrier_method import Matrix, Vector, follow_central_path

WEIGHT: Final = 1e9
"""Last weight of ``log det``: with m constraints the result is within ``2 m / WEIGHT`` of the optimum."""
FIRST_WEIGHT: Final = 30.0
"""First weight inside a polytope, where the start is near the central path."""
Cloud = Float[np.ndarray, "n d"]


@dataclass(frozen=True, eq=False)
class Ellipsoid:
    """``{center + axes u : |u| <= 1}``."""

    center: Vector
    axes: Matrix


def largest_inside(normals: Cloud, offsets: Float[np.ndarray, "n"]) -> Ellipsoid:
    """The largest ellipsoid in ``{x : normals x <= offsets}``, a polytope with the origin in its interior."""
    problem = _InscribedProblem(normals, offsets)
    return problem.ellipsoid_at(
        follow_central_path(
            problem.feasible_start(), problem.barrier_value, problem.barrier_derivatives, WEIGHT, FIRST_WEIGHT
        )
    )


def smallest_around(points: Cloud, *, centred: bool = False) -> Ellipsoid:
    """The smallest ellipsoid around points that span the space; ``centred`` fixes its centre at the origin."""
    problem = _CircumscribedProblem(points, centred)
    x = follow_central_path(problem.feasible_start(), problem.barrier_value, problem.barrier_derivatives, WEIGHT)
    Q, b = problem.matrix_and_vector(x)
    radius = np.linalg.norm(points @ Q.T - b, axis=1).max()  # puts the farthest point on the boundary
    return Ellipsoid(np.linalg.solve(Q, b), radius * np.linalg.inv(Q))


class _VectorAndTriangle:
    """Unknowns of a vector and a lower triangular matrix in one array; the matrix entries by rows."""

    def __init__(self, d: int, with_vector: bool = True) -> None:
        self.d = d
        self.lead = d if with_vector else 0
        self.rows, self.columns = np.tril_indices(d)
        self.diagonal = self.lead + np.flatnonzero(self.rows == self.columns)

    def matrix_and_vector(self, x: Vector) -> tuple[Matrix, Vector]:
        matrix = np.zeros((self.d, self.d))
        matrix[self.rows, self.columns] = x[self.lead :]
        return matrix, x[: self.lead] if self.lead else np.zeros(self.d)

    def log_det(self, x: Vector) -> float:
        diagonal = x[self.diagonal]
        return float(np.log(diagonal).sum()) if diagonal.min() > 0.0 else -np.inf

    def add_log_det(self, x: Vector, weight: float, gradient: Vector, hessian: Matrix) -> None:
        diagonal = x[self.diagonal]
        gradient[self.diagonal] -= weight / diagonal
        hessian[self.diagonal, self.diagonal] += weight / diagonal**2


class _InscribedProblem(_VectorAndTriangle):
    def __init__(self, normals: Cloud, offsets: Float[np.ndarray, "n"]) -> None:
        super().__init__(normals.shape[1])
        self.a, self.b = normals, offsets
        self.a_rows = normals[:, self.rows]
        # entry (r, c) of E changes component c of E^T a by a_r
        self.same = self.columns[:, np.newaxis] == self.columns

    def feasible_start(self) -> Vector:
        radius = 0.5 * float((self.b / np.linalg.norm(self.a, axis=1)).min())
        x = np.zeros(self.lead + len(self.rows))
        x[self.diagonal] = radius
        return x

    def barrier_value(self, x: Vector, weight: float) -> float:
        E, c = self.matrix_and_vector(x)
        s, v = self.b - self.a @ c, self.a @ E
        slack = s**2 - (v**2).sum(axis=1)
        if s.min() <= 0.0 or slack.min() <= 0.0 or not np.isfinite(self.log_det(x)):
            return np.inf
        return -weight * self.log_det(x) - float(np.log(slack).sum())

    def barrier_derivatives(self, x: Vector, weight: float) -> tuple[Vector, Matrix]:
        E, c = self.matrix_and_vector(x)
        s, v = self.b - self.a @ c, self.a @ E
        slack = s**2 - (v**2).sum(axis=1)
        rise = 2.0 * np.hstack([s[:, np.newaxis] * self.a, self.a_rows * v[:, self.columns]])
        rise /= slack[:, np.newaxis]  # minus the gradient of log slack
        aa = 2.0 * (self.a / slack[:, np.newaxis]).T @ self.a
        hessian = rise.T @ rise
        hessian[: self.d, : self.d] -= aa
        hessian[self.d :, self.d :] += aa[np.ix_(self.rows, self.rows)] * self.same
        gradient = rise.sum(axis=0)
        self.add_log_det(x, weight, gradient, hessian)
        return gradient, hessian

    def ellipsoid_at(self, x: Vector) -> Ellipsoid:
        E, c = self.matrix_and_vector(x)
        return Ellipsoid(c, E)


class _CircumscribedProblem(_VectorAndTriangle):
    def __init__(self, points: Cloud, centred: bool) -> None:
        super().__init__(points.shape[1], with_vector=not centred)
        self.p = points
        self.same = self.rows[:, np.newaxis] == self.rows

    def feasible_start(self) -> Vector:
        x = np.zeros(self.lead + len(self.rows))
        x[self.diagonal] = 0.5 / np.linalg.norm(self.p, axis=1).max()
        return x

    def barrier_value(self, x: Vector, weight: float) -> float:
        Q, b = self.matrix_and_vector(x)
        slack = 1.0 - ((self.p @ Q.T - b) ** 2).sum(axis=1)
        if slack.min() <= 0.0 or not np.isfinite(self.log_det(x)):
            return np.inf
        return -weight * self.log_det(x) - float(np.log(slack).sum())

    def barrier_derivatives(self, x: Vector, weight: float) -> tuple[Vector, Matrix]:
        Q, b = self.matrix_and_vector(x)
        u = self.p @ Q.T - b
        slack = 1.0 - (u**2).sum(axis=1)
        J_Q = self.p[:, self.columns] * u[:, self.rows]
        rise = 2.0 * (np.hstack([-u, J_Q]) if self.lead else J_Q) / slack[:, np.newaxis]
        over = 1.0 / slack
        hessian = rise.T @ rise
        pp = 2.0 * (self.p * over[:, np.newaxis]).T @ self.p
        k = self.lead
        hessian[k:, k:] += pp[np.ix_(self.columns, self.columns)] * self.same
        if k:
            cross = -2.0 * np.eye(self.d)[:, self.rows] * (over @ self.p)[self.columns]
            hessian[:k, :k] += 2.0 * over.sum() * np.eye(k)
            hessian[:k, k:] += cross
            hessian[k:, :k] += cross.T
        gradient = rise.sum(axis=0)
        self.add_log_det(x, weight, gradient, hessian)
        return gradient, hessian
