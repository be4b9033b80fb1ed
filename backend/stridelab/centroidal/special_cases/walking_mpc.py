"""Walking MPC: a quadratic program of the zero-moment point with free footsteps, (4.20) on level ground (Herdt et al.).

With the CoM at a constant height h above level contacts and no angular momentum, (4.2) leaves a triple integrator per
horizontal axis, the jerk u constant over every sample,

    c_k = S_c x_0 + U_c u,   likewise c'_k, c''_k,      z_k = c_k - h / g c''_k                            (2.9)

and the cone (4.20c) requires z to lie in the polygon of the contacts. The polygons of future steps move with their
positions p_j, which are variables beside the jerks (Herdt et al. 2010):

    min   sum dt ( w_u |u|^2 + w_a |c''|^2 + w_v |c' - v_ref|^2 + w_z |z - middle|^2 )
    s.t.  n_i (z_k - p_j(k)) <= b_i                 every edge of the polygon of sample k
          low <= p_j - p_{j-1} <= high              step length limits
          the end: free; at rest over a goal; or capturable, c + c' / w in the last polygon     (Sherikov et al. 2014)

The program is strictly convex and solved by daqp. Unlike (4.20), it has no height, friction, angular momentum,
non-coplanar contacts or densities.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import daqp
import numpy as np
from jaxtyping import Float
from scipy.spatial import ConvexHull

from stridelab.centroidal.problem import CentroidalProblem
from stridelab.centroidal.special_cases.preview_control import CartTable
from stridelab.conventions import GRAVITY_M_S2
from stridelab.errors import Fault, InvalidInput, NotEstimable

LEVEL_M = 1e-6
"""Height differences up to this count as level."""
STEP_REGULARISATION = 1e-12
"""Regularisation of the step positions, which makes them unique."""
_EQUALITY = 5
"""Constraint type of an equality in daqp."""

StepSelection = Float[np.ndarray, "n m"]
"""Selection matrix: 1 where the support of a sample is relative to a step."""
Vector2 = Float[np.ndarray, "2"]


@dataclass(frozen=True, eq=False)
class Support:
    """Convex polygon of the zero-moment point in a sample, in the world or relative to the position of a step."""

    corners_m: Float[np.ndarray, "_ 2"]
    step: int | None = None

    def edge_half_planes(self) -> tuple[Float[np.ndarray, "n 2"], Float[np.ndarray, "n"]]:
        """Outward unit normals and offsets."""
        hull = ConvexHull(self.corners_m).equations
        return hull[:, :2], -hull[:, 2]


@dataclass(frozen=True, eq=False)
class Step:
    """A future step: bounds of its position relative to the previous one."""

    low_m: Vector2
    high_m: Vector2


@dataclass(frozen=True)
class ZmpWeights:
    """Weights of the cost; the jerk weight must be positive."""

    jerk: float = 1e-6
    acceleration: float = 0.0
    velocity: float = 0.0
    zmp: float = 1.0


@dataclass(frozen=True, eq=False)
class Walk:
    """The walk to plan: a support per sample, future steps, the position of the foot before them, the end.

    ``end`` "rest" requires ``goal_m``, "capturable" a capture point inside the last support.
    """

    supports: Sequence[Support]
    steps: Sequence[Step] = ()
    previous_m: Vector2 | None = None
    velocity_m_s: tuple[float, float] = (0.0, 0.0)
    end: Literal["free", "rest", "capturable"] = "free"
    goal_m: Vector2 | None = None


@dataclass(frozen=True, eq=False)
class ZmpPlan:
    """``cart`` has one row per sample and one for the start; ``steps_m`` are the step positions."""

    cart: CartTable
    steps_m: Float[np.ndarray, "_ 2"]
    cost: float


@dataclass(frozen=True, kw_only=True)
class ZmpQuadraticProgram:
    """Quadratic program for a CoM ``height_m`` above the ground, sampled every ``dt_s``.

    Raises ``InvalidInput`` (``zmp-programme-invalid``) for parameters that are not positive.
    """

    height_m: float
    dt_s: float = 0.1
    weights: ZmpWeights = ZmpWeights()

    def __post_init__(self) -> None:
        w = self.weights
        for name, value in (("height_m", self.height_m), ("dt_s", self.dt_s), ("weights.jerk", w.jerk)):
            if not 0.0 < value < np.inf:
                message = f"{name} must be positive, not {value:g}."
                raise InvalidInput("zmp-programme-invalid", message, [Fault(name, message)])
        for name in ("acceleration", "velocity", "zmp"):
            if not 0.0 <= getattr(w, name) < np.inf:
                message = f"weights.{name} must not be negative."
                raise InvalidInput("zmp-programme-invalid", message, [Fault(f"weights.{name}", message)])

    def solve(self, state: Float[np.ndarray, "3 2"], walk: Walk) -> ZmpPlan:
        """Plan ``walk`` from ``state`` (CoM, velocity, acceleration; x and y).

        Raises ``InvalidInput`` (``zmp-programme-invalid``) for an incomplete walk, and ``NotEstimable``
        (``zmp-programme-infeasible``) if no motion keeps the zero-moment point in its polygons.
        """
        self._validate_walk(walk)
        n, m = len(walk.supports), len(walk.steps)
        maps = _TripleIntegrator(self, n)
        free = [
            maps.affine_map(self._output_rows[quantity], state)
            for quantity in ("com", "velocity", "acceleration", "zmp")
        ]
        (c0, Uc), (v0, Uv), (a0, Ua), (z0, Uz) = free
        step_selection = np.zeros((n, m))
        centres = np.zeros((n, 2))
        for k, support in enumerate(walk.supports):
            centres[k] = support.corners_m.mean(axis=0)
            if support.step is not None:
                step_selection[k, support.step] = 1.0
        w, H, f, constant = self.weights, [], [], 0.0
        for axis in range(2):
            J = np.vstack(
                [
                    np.hstack([np.sqrt(w.jerk) * np.eye(n), np.zeros((n, m))]),
                    np.hstack([np.sqrt(w.acceleration) * Ua, np.zeros((n, m))]),
                    np.hstack([np.sqrt(w.velocity) * Uv, np.zeros((n, m))]),
                    np.hstack([np.sqrt(w.zmp) * Uz, -np.sqrt(w.zmp) * step_selection]),
                ]
            )
            r = np.concatenate(
                [
                    np.zeros(n),
                    np.sqrt(w.acceleration) * a0[:, axis],
                    np.sqrt(w.velocity) * (v0[:, axis] - walk.velocity_m_s[axis]),
                    np.sqrt(w.zmp) * (z0[:, axis] - centres[:, axis]),
                ]
            )
            H.append(2.0 * self.dt_s * (J.T @ J + STEP_REGULARISATION * np.diag([0.0] * n + [1.0] * m)))
            f.append(2.0 * self.dt_s * J.T @ r)
            constant += self.dt_s * float(r @ r)
        A, upper, lower, sense = self._constraint_rows(walk, (c0, Uc), (v0, Uv), (a0, Ua), (z0, Uz), step_selection)
        size = n + m
        P = np.zeros((2 * size, 2 * size))
        P[:size, :size], P[size:, size:] = H
        y, cost, flag, _ = daqp.solve(P, np.concatenate(f), A, upper, lower, sense, primal_tol=1e-9, iter_limit=20_000)
        if flag <= 0:
            raise NotEstimable(
                "zmp-programme-infeasible", "No motion at this height keeps the zero-moment point over the contacts."
            )
        u = np.column_stack([y[:n], y[size : size + n]])
        rows = [
            np.vstack([s, x0 + U @ u])
            for s, (x0, U) in zip([*state, state[0] - self._height_over_g * state[2]], free, strict=True)
        ]
        steps = np.column_stack([y[n:size], y[size + n :]])
        return ZmpPlan(CartTable(*rows), steps, float(cost) + constant)

    @property
    def _height_over_g(self) -> float:
        return self.height_m / GRAVITY_M_S2

    @property
    def _output_rows(self) -> dict[str, Float[np.ndarray, "3"]]:
        return {
            "com": np.array([1.0, 0.0, 0.0]),
            "velocity": np.array([0.0, 1.0, 0.0]),
            "acceleration": np.array([0.0, 0.0, 1.0]),
            "zmp": np.array([1.0, 0.0, -self._height_over_g]),
        }

    def _validate_walk(self, walk: Walk) -> None:
        missing = []
        if not walk.supports:
            missing.append(Fault("supports", "must have at least one sample"))
        if walk.steps and walk.previous_m is None:
            missing.append(Fault("previous_m", "steps need the position of the previous foot"))
        if walk.end == "rest" and walk.goal_m is None:
            missing.append(Fault("goal_m", "rest at the end needs a goal"))
        if any(s.step is not None and not 0 <= s.step < len(walk.steps) for s in walk.supports):
            missing.append(Fault("supports", "a support refers to a step that does not exist"))
        if missing:
            raise InvalidInput("zmp-programme-invalid", f"The walk is incomplete: {missing[0].message}.", missing)

    def _constraint_rows(
        self,
        walk: Walk,
        com: "_Affine",
        velocity: "_Affine",
        acceleration: "_Affine",
        zmp: "_Affine",
        step_selection: StepSelection,
    ) -> tuple[Float[np.ndarray, "rows _"], Float[np.ndarray, "rows"], Float[np.ndarray, "rows"], np.ndarray]:
        """Constraint rows on ``(u_x, p_x, u_y, p_y)``."""
        n, m = step_selection.shape
        rows, upper, lower, sense = [], [], [], []

        def add_row(parts: Sequence[tuple[np.ndarray, np.ndarray]], most: float, least: float, kind: int = 0) -> None:
            rows.append(np.concatenate([np.concatenate(part) for part in parts]))
            upper.append(most)
            lower.append(least)
            sense.append(kind)

        zero_part = (np.zeros(n), np.zeros(m))
        capture_point = None
        if walk.end == "capturable":
            time_constant_s = np.sqrt(self._height_over_g)
            capture_point = (com[0] + time_constant_s * velocity[0], com[1] + time_constant_s * velocity[1])
        constraints = [(k, support, zmp, k) for k, support in enumerate(walk.supports)]
        if capture_point is not None:
            constraints.append((n - 1, walk.supports[-1], capture_point, n - 1))
        for k, support, (x0, U), sample in constraints:
            for normal, offset in zip(*support.edge_half_planes(), strict=True):
                add_row(
                    [(normal[axis] * U[k], -normal[axis] * step_selection[sample]) for axis in range(2)],
                    offset - float(normal @ x0[k]),
                    -1e30,
                )
        for j, step in enumerate(walk.steps):
            last = np.zeros(2) if j or walk.previous_m is None else walk.previous_m
            for axis in range(2):
                e = np.eye(m)[j] - (np.eye(m)[j - 1] if j else 0.0)
                parts = [zero_part, zero_part]
                parts[axis] = (np.zeros(n), e)
                add_row(parts, float(step.high_m[axis] + last[axis]), float(step.low_m[axis] + last[axis]))
        if walk.end == "rest" and walk.goal_m is not None:
            for (x0, U), target in ((com, walk.goal_m), (velocity, np.zeros(2)), (acceleration, np.zeros(2))):
                for axis in range(2):
                    parts = [zero_part, zero_part]
                    parts[axis] = (U[-1], np.zeros(m))
                    value = float(target[axis] - x0[-1, axis])
                    add_row(parts, value, value, _EQUALITY)
        return np.array(rows), np.array(upper), np.array(lower), np.array(sense, dtype=np.int32)


_Affine = tuple[Float[np.ndarray, "n 2"], Float[np.ndarray, "n n"]]
"""A quantity without jerks, per axis, and its dependence on the jerks."""


class _TripleIntegrator:
    """Powers of the triple integrator over ``n`` samples."""

    def __init__(self, qp: ZmpQuadraticProgram, n: int) -> None:
        dt = qp.dt_s
        A = np.array([[1.0, dt, dt * dt / 2.0], [0.0, 1.0, dt], [0.0, 0.0, 1.0]])
        B = np.array([dt**3 / 6.0, dt * dt / 2.0, dt])
        self.powers = [np.eye(3)]
        for _ in range(n):
            self.powers.append(A @ self.powers[-1])
        self.responses = np.array([P @ B for P in self.powers[:-1]])

    def affine_map(self, row: Float[np.ndarray, "3"], state: Float[np.ndarray, "3 2"]) -> _Affine:
        """The quantity ``row @ x`` at the samples 1 to n as an affine function of the jerks."""
        n = len(self.responses)
        free = np.array([row @ P @ state for P in self.powers[1:]])
        responses = self.responses @ row
        U = np.array([[responses[k - i] if i <= k else 0.0 for i in range(n)] for k in range(n)])
        return free, U


def level_supports(problem: CentroidalProblem, dt_s: float) -> list[Support]:
    """Support polygons per sample of a problem whose contacts are level and at one height.

    Raises ``InvalidInput`` (``contacts-not-level``) for other contacts and for phases without contacts.
    """
    polygons = []
    heights = [c.placement.position_m[2] for p in problem.sequence.phases for c in p.contacts.values()]
    for i, phase in enumerate(problem.sequence.phases):
        tilted = any(c.placement.rotation[2, 2] < 1.0 - LEVEL_M for c in phase.contacts.values())
        if not phase.contacts or tilted or np.ptp(heights) > LEVEL_M:
            message = "The zero-moment point needs contacts on one level plane in every phase."
            raise InvalidInput("contacts-not-level", message, [Fault(f"phases[{i}]", message)])
        points = [c.placement.act(problem.points_m(name))[:, :2] for name, c in phase.contacts.items()]
        corners = np.vstack(points)
        polygons.append(Support(corners[ConvexHull(corners).vertices]))
    n = round(problem.sequence.duration_s / dt_s)
    return [polygons[problem.sequence.phase_at((k + 0.5) * dt_s)] for k in range(n)]
