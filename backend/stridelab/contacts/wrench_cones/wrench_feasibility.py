"""Feasibility margin of a wrench for a contact set, and the contact forces that attain it.

    t* = max t   such that   sum_i (f_i, p_i x f_i) = w   and   mu_i f_n,i - |f_t,i| >= t   at every point

in newtons of additional tangential force that every point could resist; if negative, friction lacks that much. It
depends neither on the reference point nor on the unit of length. Circular cones give a second-order cone program,
solved by a barrier method in the null space of the grasp matrix; pyramids of n rays give a linear program, solved by
HiGHS. The margin is infinite if squeezing makes t* unbounded, and minus infinity if no forces produce the wrench (two
points cannot resist a moment about the line between them).
"""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float
from scipy.optimize import linprog

from stridelab.contacts.barrier_method import Matrix, Vector, follow_central_path
from stridelab.contacts.wrench_cones.contact_points import PointContacts
from stridelab.conventions import Points
from stridelab.errors import InvalidInput, NotEstimable

WEIGHT: Final = 1e11
"""Last weight of ``t`` relative to the wrench: with n points ``t*`` is within ``2 n / WEIGHT`` of the optimum."""
RESIDUAL_TOLERANCE: Final = 1e-9
"""Relative residual above which no forces produce the wrench."""
INFINITE_RATIO: Final = 1e3
"""Ratio of margin to wrench above which the margin counts as infinite."""


@dataclass(frozen=True, eq=False)
class WrenchMargin:
    """Margin ``margin_n`` = t* and forces that attain it, one row per point (feasible ones for an infinite margin)."""

    margin_n: float
    forces_n: Points


def conic_margin(contacts: PointContacts, wrench: Float[np.ndarray, "6"]) -> WrenchMargin:
    """The margin with circular friction cones; ``wrench`` is (force, moment) about the world origin.

    Raises ``InvalidInput`` (``wrench-invalid``) for a non-finite one.
    """
    problem = _MarginProblem(contacts, wrench)
    if problem.particular is None:
        return problem.infeasible_margin()
    bounded = problem.solve_linear(16)
    if bounded.margin_n > INFINITE_RATIO * problem.size:
        return bounded
    x = follow_central_path(problem.feasible_start(), problem.barrier_value, problem.barrier_derivatives, WEIGHT)
    return WrenchMargin(float(x[-1]) * problem.size, problem.contact_forces(x))


def linear_margin(contacts: PointContacts, wrench: Float[np.ndarray, "6"], n_rays: int = 4) -> WrenchMargin:
    """The margin with pyramids of ``n_rays`` inside the friction cones: ``t`` to the nearest of their faces."""
    problem = _MarginProblem(contacts, wrench)
    return problem.infeasible_margin() if problem.particular is None else problem.solve_linear(n_rays)


class _MarginProblem:
    """Forces and lengths in units of the wrench and of the contacts' spread; unknowns ``(z, t)``, ``f = f0 + N z``."""

    def __init__(self, contacts: PointContacts, wrench: Float[np.ndarray, "6"]) -> None:
        if not np.isfinite(wrench).all():
            raise InvalidInput("wrench-invalid", "a wrench must be finite")
        self.n = len(contacts.position_m)
        center = contacts.position_m.mean(axis=0)
        spread = float(np.sqrt(((contacts.position_m - center) ** 2).sum(axis=1).mean())) or 1.0
        scale = np.repeat([1.0, 1.0 / spread], 3)
        self.grasp = contacts.grasp_matrix(center) * scale[:, np.newaxis]
        own = np.concatenate([wrench[:3], wrench[3:] - np.cross(center, wrench[:3])]) * scale
        self.size = float(np.linalg.norm(own)) or 1.0
        self.wrench = own / self.size
        U, S, Vt = np.linalg.svd(self.grasp)
        rank = int((RESIDUAL_TOLERANCE * S[0] < S).sum())
        f0 = Vt[:rank].T @ (U[:, :rank].T @ self.wrench / S[:rank])
        self.particular = f0 if np.linalg.norm(self.grasp @ f0 - self.wrench) < RESIDUAL_TOLERANCE else None
        self.null = Vt[rank:].T
        # rows of mu n, of the tangents x and y, per point
        axes = contacts.rotation.transpose(0, 2, 1)
        self.local = axes * np.stack([np.ones(self.n), np.ones(self.n), contacts.friction], axis=1)[:, :, np.newaxis]
        rows = np.einsum("nak,nkz->naz", self.local, self.null.reshape(self.n, 3, -1))
        self.tangents = np.concatenate([rows[:, :2], np.zeros((self.n, 2, 1))], axis=2)
        self.normals = np.concatenate([rows[:, 2], -np.ones((self.n, 1))], axis=1)
        self.fixed = np.einsum("nak,nk->na", self.local, f0.reshape(self.n, 3))

    def infeasible_margin(self) -> WrenchMargin:
        return WrenchMargin(-math.inf, np.zeros((self.n, 3)))

    def contact_forces(self, x: Vector) -> Points:
        assert self.particular is not None
        return self.size * np.asarray(self.particular + self.null @ x[:-1]).reshape(self.n, 3)

    def feasible_start(self) -> Vector:
        x = np.zeros(self.null.shape[1] + 1)
        x[-1] = float((self.fixed[:, 2] - np.linalg.norm(self.fixed[:, :2], axis=1)).min()) - 1.0
        return x

    def barrier_value(self, x: Vector, weight: float) -> float:
        height, across = self._normal_and_tangential(x)
        radius = np.linalg.norm(across, axis=1)
        if (height - radius).min() <= 0.0:
            return math.inf
        return -weight * float(x[-1]) - float(np.log((height - radius) * (height + radius)).sum())

    def barrier_derivatives(self, x: Vector, weight: float) -> tuple[Vector, Matrix]:
        height, across = self._normal_and_tangential(x)
        radius = np.linalg.norm(across, axis=1)
        along = (
            np.where(radius[:, np.newaxis] > 0.0, across, [1.0, 0.0])
            / np.where(radius > 0.0, radius, 1.0)[:, np.newaxis]
        )
        radial = np.einsum("na,naz->nz", along, self.tangents)
        aside = along[:, :1] * self.tangents[:, 1] - along[:, 1:] * self.tangents[:, 0]
        # -log(h^2 - r^2) = -log(h - r) - log(h + r), as a sum of squares: no digits cancel
        near = (self.normals - radial) / (height - radius)[:, np.newaxis]
        far = (self.normals + radial) / (height + radius)[:, np.newaxis]
        aside *= np.sqrt(2.0 / ((height - radius) * (height + radius)))[:, np.newaxis]
        gradient = -near.sum(axis=0) - far.sum(axis=0)
        gradient[-1] -= weight
        return gradient, near.T @ near + far.T @ far + aside.T @ aside

    def solve_linear(self, n_rays: int) -> WrenchMargin:
        """``mu cos(pi / n) f_n - (cos b_j, sin b_j) f_t >= t`` on the faces of every pyramid."""
        angle = 2.0 * np.pi * np.arange(n_rays) / n_rays
        faces = np.stack([np.cos(angle), np.sin(angle), np.full(n_rays, -np.cos(np.pi / n_rays))], axis=1)
        rows = np.zeros((self.n, n_rays, 3 * self.n + 1))
        for i, local in enumerate(self.local):
            rows[i, :, 3 * i : 3 * i + 3] = faces @ local
        rows[:, :, -1] = 1.0
        solution = linprog(
            np.append(np.zeros(3 * self.n), -1.0),
            A_ub=rows.reshape(-1, 3 * self.n + 1),
            b_ub=np.zeros(self.n * n_rays),
            A_eq=np.hstack([self.grasp, np.zeros((6, 1))]),
            b_eq=self.wrench,
            bounds=[(None, None)] * (3 * self.n) + [(None, 10.0 * INFINITE_RATIO)],
            options={"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10},
        )
        if solution.x is None:
            raise NotEstimable("wrench-margin-unsolved", f"the linear program of the margin failed: {solution.message}")
        t = float(solution.x[-1])
        forces = self.size * solution.x[:-1].reshape(self.n, 3)
        return WrenchMargin(math.inf if t > INFINITE_RATIO else t * self.size, forces)

    def _normal_and_tangential(self, x: Vector) -> tuple[Float[np.ndarray, "n"], Float[np.ndarray, "n 2"]]:
        return self.fixed[:, 2] + self.normals @ x, self.fixed[:, :2] + self.tangents @ x
