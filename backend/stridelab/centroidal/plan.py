"""The centroidal plan: trajectories at the nodes, forces between them, and solver statistics.

``CentroidalPlan.reference_at`` and ``forces_at`` evaluate it at any time, for constant and spline forces alike;
``references_at`` and ``forces_over`` at many times at once, in a fiftieth of the time each.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int

from stridelab.centroidal.force_splines import DEGREE, bernstein_coefficients, bernstein_weights
from stridelab.centroidal.nlp.kkt import Solution
from stridelab.contacts.sequence import ContactSequence
from stridelab.conventions import Points, Series, Vector3, g
from stridelab.dynamics.spatial import cross

REGULARISERS = ("surface_force", "point_force", "duration")
"""Cost terms that the objective leaves out."""


def objective(terms: Mapping[str, float]) -> float:
    """(4.20a): the sum of all terms except the regularisers."""
    return float(sum(value for name, value in terms.items() if name not in REGULARISERS))


@dataclass(frozen=True)
class Reference:
    """The plan at one instant: CoM (m) with two derivatives, angular momentum about it (N m s) with one."""

    com_m: Vector3
    com_v_m_s: Vector3
    com_a_m_s2: Vector3
    l_nms: Vector3
    l_rate_nm: Vector3
    interval: int


@dataclass(frozen=True, eq=False)
class References:
    """``Reference`` at n instants, whose vectors are the rows of ``(n, 3)`` arrays; ``[i]`` is the i-th one."""

    com_m: Points
    com_v_m_s: Points
    com_a_m_s2: Points
    l_nms: Points
    l_rate_nm: Points
    interval: Int[np.ndarray, "n"]

    def __getitem__(self, i: int) -> Reference:
        return Reference(
            self.com_m[i],
            self.com_v_m_s[i],
            self.com_a_m_s2[i],
            self.l_nms[i],
            self.l_rate_nm[i],
            int(self.interval[i]),
        )


@dataclass(frozen=True, eq=False)
class Verification:
    """Check of the solution, recomputed independently of the solver.

    ``dynamics_gap``: largest gap between a node and the exact integral of the forces over the interval before it
    (m, m/s and N m s, divided by 1 m, 1 m/s, 1 N m s); ``terminal_gap`` likewise at the end against rest at the goal;
    ``cone_margin_n``: smallest ``mu f_n - |f_t|`` over all contact points; ``normal_force_min_n``: smallest ``f_n``.
    """

    dynamics_gap: float
    terminal_gap: float
    cone_margin_n: float
    normal_force_min_n: float


@dataclass(frozen=True, eq=False)
class CentroidalPlan:
    """Solution of (4.20) on ``n`` nodes, ``m = n - 1`` intervals with forces that are constant or cubic.

    ``forces_n`` gives, per effector, the world-frame force on every contact point ``(m, k, 3)``, averaged over the
    interval, zero without contact; ``curves_n`` their control points ``(m, 4, k, 3)`` for splines, empty for constant
    forces. ``points_m`` are the contact points ``(k, 3)`` in the contact frame, ``phase`` the contact phase of each
    interval, ``com_a_m_s2`` the mean acceleration. ``objective`` is (4.20a) without regularisers; all terms are in
    ``cost_terms``, which are computed where they are read. ``sequence`` contains solved durations and placements where
    they are free. ``solution`` holds the solver attempts.
    """

    sequence: ContactSequence
    mass_kg: float
    time_s: Float[np.ndarray, "n"]
    phase: Int[np.ndarray, "m"]
    com_m: Float[np.ndarray, "n 3"]
    com_v_m_s: Float[np.ndarray, "n 3"]
    com_a_m_s2: Float[np.ndarray, "m 3"]
    l_nms: Float[np.ndarray, "n 3"]
    forces_n: Mapping[str, Float[np.ndarray, "m k 3"]]
    points_m: Mapping[str, Float[np.ndarray, "k 3"]]
    solver: str
    converged: bool
    status: str
    iterations: int
    compute_cost_terms: Callable[[], Mapping[str, float]]
    solve_time_s: float
    build_time_s: float
    verification: Verification
    solution: Solution | None = None
    curves_n: Mapping[str, Float[np.ndarray, "m 4 k 3"]] = field(default_factory=dict)

    @cached_property
    def cost_terms(self) -> Mapping[str, float]:
        """Every term by its name."""
        return self.compute_cost_terms()

    @property
    def objective(self) -> float:
        """(4.20a): the sum of all terms except the regularisers."""
        return objective(self.cost_terms)

    def forces_at(self, time_s: float) -> Mapping[str, Float[np.ndarray, "k 3"]]:
        """World-frame forces on the points of every effector; at a node those of the following interval."""
        k, e, h = self._interval_at(time_s)
        if not self.curves_n:
            return {name: f[k] for name, f in self.forces_n.items()}
        flat = bernstein_weights(e / h)[0] @ self._control_points[k]
        return {name: flat[columns].reshape(-1, 3) for name, columns in self._force_columns.items()}

    def reference_at(self, time_s: float) -> Reference:
        """Reference at ``time_s``, integrated exactly from the preceding node.

        Constant forces give a constant acceleration; the angular momentum is then interpolated linearly between nodes,
        consistent with its mean rate in the cost.
        """
        k, e, h = self._interval_at(time_s)
        if self.curves_n:
            return self._spline_reference(k, e / h, h)
        a = self.com_a_m_s2[k]
        l_rate = (self.l_nms[k + 1] - self.l_nms[k]) / h
        return Reference(
            com_m=self.com_m[k] + e * self.com_v_m_s[k] + 0.5 * e * e * a,
            com_v_m_s=self.com_v_m_s[k] + e * a,
            com_a_m_s2=a,
            l_nms=self.l_nms[k] + e * l_rate,
            l_rate_nm=l_rate,
            interval=k,
        )

    def forces_over(self, time_s: Series) -> dict[str, Float[np.ndarray, "n k 3"]]:
        """``forces_at`` for many times at once."""
        k, e, h = self._intervals_at(time_s)
        if not self.curves_n:
            return {name: f[k] for name, f in self.forces_n.items()}
        weights = _bernstein_weights_at((e / h)[:, 0])[:, 0]
        flat = np.einsum("nd,ndc->nc", weights, self._control_points[k])
        return {name: flat[:, columns].reshape(len(k), -1, 3) for name, columns in self._force_columns.items()}

    def references_at(self, time_s: Series) -> References:
        """``reference_at`` for many times at once."""
        k, e, h = self._intervals_at(time_s)
        m, c, v = self.mass_kg, self.com_m[k], self.com_v_m_s[k]
        if not self.curves_n:
            a, l_rate = self.com_a_m_s2[k], (self.l_nms[k + 1] - self.l_nms[k]) / h
            return References(c + e * v + 0.5 * e * e * a, v + e * a, a, self.l_nms[k] + e * l_rate, l_rate, k)
        s = e / h
        weights = _bernstein_weights_at(s[:, 0])
        f, first, second, third = np.moveaxis(weights @ self._wrench_control_points[k], 1, 0)
        com_m = c + e * v + h**2 * (second[:, :3] / m + s**2 / 2 * g)
        velocity = v + h * (first[:, :3] / m + s * g)
        com_integral = e * c + e**2 / 2 * v + h**3 * (third[:, :3] / m + s**3 / 6 * g)
        K = self.l_nms[k] + m * np.cross(c, v) + h * first[:, 3:] + m * np.cross(com_integral, g)
        return References(
            com_m=com_m,
            com_v_m_s=velocity,
            com_a_m_s2=f[:, :3] / m + g,
            l_nms=K - m * np.cross(com_m, velocity),
            l_rate_nm=f[:, 3:] - np.cross(com_m, f[:, :3]),
            interval=k,
        )

    def _intervals_at(
        self, time_s: Series
    ) -> tuple[Int[np.ndarray, "n"], Float[np.ndarray, "n 1"], Float[np.ndarray, "n 1"]]:
        """``_interval_at`` for many times at once; times are columns ``(n, 1)``."""
        k = np.clip(self.time_s.searchsorted(time_s, side="right") - 1, 0, len(self.time_s) - 2)
        h = (self.time_s[k + 1] - self.time_s[k])[:, None]
        return k, np.clip(time_s[:, None] - self.time_s[k][:, None], 0.0, h), h

    def _interval_at(self, time_s: float) -> tuple[int, float, float]:
        """Interval, time (s) since its start, and its length (s)."""
        k = min(max(int(self.time_s.searchsorted(time_s, side="right")) - 1, 0), len(self.time_s) - 2)
        h = float(self.time_s[k + 1] - self.time_s[k])
        return k, min(max(time_s - float(self.time_s[k]), 0.0), h), h

    @cached_property
    def _force_columns(self) -> Mapping[str, slice]:
        """Columns of each effector in ``_control_points``."""
        ends = np.cumsum([3 * curve.shape[2] for curve in self.curves_n.values()]).tolist()
        return dict(zip(self.curves_n, map(slice, [0, *ends], ends), strict=False))

    @cached_property
    def _control_points(self) -> Float[np.ndarray, "m 4 n"]:
        """Control points of all forces side by side."""
        return np.concatenate([curve.reshape(*curve.shape[:2], -1) for curve in self.curves_n.values()], axis=2)

    @cached_property
    def _wrench_control_points(self) -> Float[np.ndarray, "m 4 6"]:
        """Control points of ``(sum f, sum p x f)`` about the world origin."""
        wrenches = np.zeros((len(self.phase), 4, 6))
        for phase in np.unique(self.phase).tolist():
            during = self.phase == phase
            for name, contact in self.sequence.phases[phase].contacts.items():
                f = self.curves_n[name][during]
                (x, y, z), (f_x, f_y, f_z) = contact.placement.act(self.points_m[name]).T, np.moveaxis(f, 3, 0)
                moments = (y * f_z - z * f_y, z * f_x - x * f_z, x * f_y - y * f_x)
                wrenches[during] += np.stack([f_x, f_y, f_z, *moments], axis=3).sum(axis=2)
        return wrenches

    def _spline_reference(self, k: int, s: float, h: float) -> Reference:
        """Integrate ``dynamics`` with Bernstein polynomials: the momentum K about the origin, then about the CoM."""
        m, c, v = self.mass_kg, self.com_m[k], self.com_v_m_s[k]
        f, first_integral, second_integral, third_integral = bernstein_weights(s) @ self._wrench_control_points[k]
        com = c + h * s * v + h**2 * (second_integral[:3] / m + s**2 / 2 * g)
        velocity = v + h * (first_integral[:3] / m + s * g)
        com_integral = h * s * c + h**2 * s**2 / 2 * v + h**3 * (third_integral[:3] / m + s**3 / 6 * g)
        K = self.l_nms[k] + m * cross(c, v) + h * first_integral[3:] + m * cross(com_integral, g)
        return Reference(
            com_m=com,
            com_v_m_s=velocity,
            com_a_m_s2=f[:3] / m + g,
            l_nms=K - m * cross(com, velocity),
            l_rate_nm=f[3:] - cross(com, f[:3]),
            interval=k,
        )


def _bernstein_weights_at(s: Series) -> Float[np.ndarray, "n 4 d"]:
    """``bernstein_weights`` for many s at once."""
    return np.asarray(np.einsum("idp,np->nid", bernstein_coefficients(DEGREE), s[:, None] ** np.arange(DEGREE + 4)))
