"""What the centroidal stage hands on: trajectories at the nodes, forces between them, and how they were found."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from stridelab.centroidal.solution import Solution
from stridelab.contacts.sequence import ContactSequence
from stridelab.conventions import Vector3


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
class Verification:
    """The solution checked by plain arithmetic, apart from the solver.

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
    """Solution of (4.20) on ``n`` nodes, ``m = n - 1`` intervals with constant forces.

    ``forces_n`` gives, per effector, the world-frame force on every contact point ``(m, k, 3)``, zero where it does
    not touch; ``points_m`` the points ``(k, 3)`` in the contact frame at which they act. ``phase`` is the contact
    phase of each interval. ``objective`` is (4.20a) without regularisers, all terms are in ``cost_terms``. Where
    durations or contacts were free, ``sequence`` is what was chosen. ``solution`` tells how it was found.
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
    objective: float
    cost_terms: Mapping[str, float]
    solve_time_s: float
    build_time_s: float
    verification: Verification
    solution: Solution | None = None

    def at(self, time_s: float) -> Reference:
        """Reference at ``time_s``.

        The CoM is integrated exactly from the node before, its acceleration being constant between nodes; the angular
        momentum is linear between nodes.
        """
        k = int(np.clip(np.searchsorted(self.time_s, time_s, side="right") - 1, 0, len(self.time_s) - 2))
        h = self.time_s[k + 1] - self.time_s[k]
        e = float(np.clip(time_s - self.time_s[k], 0.0, h))
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
