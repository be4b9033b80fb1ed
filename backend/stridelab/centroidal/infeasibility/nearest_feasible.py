"""Nearest feasible problem: durations or placements with the smallest change for which the constraints are feasible.

    min  sum |theta_i|  +  P (sum T s + ... of ``elastic_lp``)      over theta and the variables of ``elastic_lp``

theta are seconds added to the phases, or shifts (in decimetres) of contacts along x and y of their own frames. The rows
are not linear in theta: an interval's end state changes with its length h as A'(h) x + B'(h) (F, T) + b'(h), its moment
with a contact's position as dp x f. The method is sequential linear programming: each linear program is built at the
last solution within a trust region, and each step is accepted or rejected by the exact elastic program. P is large
enough that slacks vanish at the solution if they can. The solution lies on the boundary of the feasible set; every
change is therefore enlarged by one of the ``RESERVES``.
"""

import time
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import scipy.sparse as sp
from jaxtyping import Int

from stridelab.centroidal.contact_wrench import DOWN, N_STATE, Step, discrete_step, skew
from stridelab.centroidal.free_variables import ContactSpan, movable_spans, move_contacts
from stridelab.centroidal.infeasibility.body_limits import body_limit_rows
from stridelab.centroidal.infeasibility.elastic_lp import ElasticSolution, minimise_linear, solve_elastic
from stridelab.centroidal.infeasibility.lp_constraints import (
    LinearConstraints,
    SparseBlocks,
    Vector,
    Where,
    adhesion_columns,
    end_slack_columns,
    linear_constraints,
)
from stridelab.centroidal.placement_windows import placement_window_m
from stridelab.centroidal.problem import CentroidalProblem, Grid
from stridelab.contacts.sequence import ContactSequence
from stridelab.conventions import GRAVITY_M_S2, Vector3

ChangeKind = Literal["durations", "placements"]
Counts = Int[np.ndarray, "phases"]
PENALTY = 100.0
"""Price of slacks, per weight and second and per metre and second."""
RESERVES = (0.1, 0.25, 0.5, 1.0)
"""Shares by which the smallest sufficient change is enlarged, tried in this order."""
RATE_HZ = 3.0
"""Nodes per second, fewer than in a plan: feasibility on a coarse grid implies it on a finer one."""
COARSE, FINE = 3, 5
"""Minimum intervals per phase in the search, and on the confirmation grid with twice as many nodes per second."""
MIN_PHASE_S = 0.05
DECIMETRE_M = 0.1
MAX_SHIFT_M = 2.0
"""Maximum distance by which a contact may be moved."""
MAX_ITERATIONS = 25
INITIAL_RADIUS = 0.4
MIN_RADIUS = 1e-3


@dataclass(frozen=True, eq=False)
class NearestFeasible:
    """A contact sequence near the given one.

    ``is_feasible``: whether its constraints and body limits are feasible. ``longer_s``: change of each phase's
    duration; ``shifts_m``: world-frame shifts of the contacts, by their first phase and effector.
    """

    sequence: ContactSequence
    is_feasible: bool
    longer_s: Vector
    shifts_m: dict[Where, Vector3]


def nearest_feasible(problem: CentroidalProblem, change: ChangeKind, until_s: float = np.inf) -> NearestFeasible | None:
    """Change the durations, or the placements of the contacts that begin and end within the motion.

    Returns None if there is nothing to change, or if the process time has already passed ``until_s``, at which the
    search ends.
    """
    spans = movable_spans(problem.sequence) if change == "placements" else []
    search = _Search(problem, change, spans, _interval_counts(problem, RATE_HZ, COARSE))
    if time.process_time() > until_s:
        return None
    limits = search.change_bounds()
    theta, region = np.zeros(len(limits[0])), INITIAL_RADIUS
    current = search.solve_changed(theta)
    if not len(theta) or current is None:
        return None
    for _ in range(MAX_ITERATIONS):
        converged = current.price < MIN_RADIUS and region < INITIAL_RADIUS and np.abs(theta).sum() < MIN_RADIUS
        if converged or time.process_time() > until_s:
            break
        candidate = search.linearised_step(theta, current, region, limits)
        candidate_solution = None if candidate is None else search.solve_changed(candidate)
        if (
            candidate is None
            or candidate_solution is None
            or _merit_value(candidate, candidate_solution) > _merit_value(theta, current) - MIN_RADIUS / 10.0
        ):
            region /= 3.0
            if region < MIN_RADIUS:
                break
            continue
        theta, current, region = candidate, candidate_solution, min(INITIAL_RADIUS, 1.5 * region)
    return search.with_reserve(theta, until_s)


@dataclass(frozen=True, eq=False)
class _Search:
    """Search for a change theta of one kind: with ``counts`` intervals per phase, of ``spans`` if contacts move."""

    problem: CentroidalProblem
    change: ChangeKind
    spans: list[ContactSpan]
    counts: Counts

    def change_bounds(self) -> tuple[Vector, Vector]:
        """Bounds of theta: phases last ``MIN_PHASE_S``; contacts stay within their windows, including the reserve."""
        sequence = self.problem.sequence
        if self.change == "durations":
            return np.minimum(0.0, MIN_PHASE_S - sequence.durations_s), np.full(len(sequence.phases), np.inf)
        windows = [
            placement_window_m(
                span.contact, self.problem.points_m(span.contact.effector), sequence.terrain, (MAX_SHIFT_M, MAX_SHIFT_M)
            )
            for span in self.spans
        ]
        low, high = (np.concatenate([np.zeros(0), *(room[side] for room in windows)]) for side in (0, 1))
        scale = (1.0 + RESERVES[0]) * DECIMETRE_M
        return low / scale, high / scale

    def shifts_m(self, theta: Vector) -> list[Vector3]:
        """World-frame shift of the contact of every span."""
        along = theta.reshape(-1, 2) if self.spans else ()
        return [
            np.asarray(DECIMETRE_M * span.contact.placement.rotation[:, :2] @ xy)
            for span, xy in zip(self.spans, along, strict=True)
        ]

    def apply_change(self, theta: Vector) -> CentroidalProblem:
        """The problem with the change."""
        sequence = self.problem.sequence
        if self.change == "durations":
            sequence = sequence.with_durations(np.maximum(MIN_PHASE_S, sequence.durations_s + theta))
        return replace(self.problem, sequence=move_contacts(sequence, self.spans, self.shifts_m(theta)))

    def solve_changed(self, theta: Vector) -> ElasticSolution | None:
        """Elastic solution of the changed problem."""
        changed = self.apply_change(theta)
        return solve_elastic(changed, cones=PENALTY, body=PENALTY, end=PENALTY, grid=grid_of(changed, self.counts))

    def with_reserve(self, theta: Vector, until_s: float) -> NearestFeasible:
        """Enlarge the change by the smallest reserve that is feasible on a finer grid, or the last one tried."""
        for reserve in RESERVES if self.change == "durations" else RESERVES[:1]:
            enlarged = (1.0 + reserve) * np.where(np.abs(theta) > MIN_RADIUS, theta, 0.0)
            changed = self.apply_change(enlarged)
            fine = grid_of(changed, _interval_counts(changed, 2.0 * RATE_HZ, FINE))
            final = solve_elastic(changed, cones=PENALTY, body=PENALTY, end=PENALTY, grid=fine)
            feasible = final is not None and final.is_feasible
            if feasible or time.process_time() > until_s:
                break
        moves = zip(self.spans, self.shifts_m(enlarged), strict=True)
        return NearestFeasible(
            changed.sequence,
            feasible,
            changed.sequence.durations_s - self.problem.sequence.durations_s,
            {(span.first, span.contact.effector): shift_m for span, shift_m in moves if shift_m.any()},
        )

    def linearised_step(
        self, theta: Vector, current: ElasticSolution, radius: float, limits: tuple[Vector, Vector]
    ) -> Vector | None:
        """Theta of the linear program linearised at the solution ``current``."""
        low, high = np.maximum(theta - radius, limits[0]), np.minimum(theta + radius, limits[1])
        changed = self.apply_change(theta)
        lp = linear_constraints(changed, grid_of(changed, self.counts))
        m, n = lp.A.shape
        _, sticks, seconds = adhesion_columns(lp, changed)
        G, room = body_limit_rows(lp, changed, current.w[: N_STATE * (len(lp.grid.step_s) + 1)].reshape(-1, N_STATE))
        J, H = (
            (_duration_derivatives(lp, changed, current), sp.csc_matrix((G.shape[0], len(theta))))
            if self.change == "durations"
            else _placement_derivatives(lp, changed, current, self.spans, G.shape[0])
        )
        durations_s = changed.sequence.durations_s
        slacks = PENALTY * np.concatenate([seconds, seconds, seconds, durations_s, np.ones(2 * lp.n_end)])
        size, count = len(theta), len(slacks)
        E, zero = sp.identity(size), sp.csc_matrix((size, n + count))
        no_columns = sp.csc_matrix((m, 2 * len(seconds) + len(durations_s)))
        miss, n_end = end_slack_columns(lp), lp.n_end
        solution = minimise_linear(
            np.concatenate([np.zeros(n), slacks, np.zeros(size), np.ones(size)]),
            (
                sp.hstack([lp.A, sticks, no_columns, miss, -miss, J, sp.csc_matrix((m, size))], format="csc"),
                lp.b + J @ theta,
            ),
            (
                sp.vstack(
                    [
                        sp.hstack([G, sp.csc_matrix((G.shape[0], 2 * n_end)), H, sp.csc_matrix(H.shape)]),
                        sp.hstack([zero, E, -E]),
                        sp.hstack([zero, -E, -E]),
                    ],
                    format="csc",
                ),
                np.concatenate([room + H @ theta, np.zeros(2 * size)]),
            ),
            np.column_stack(
                [
                    np.concatenate([lp.lower, np.zeros(count), low, np.zeros(size)]),
                    np.concatenate([np.full(n + count, np.inf), high, np.full(size, np.inf)]),
                ]
            ),
        )
        return None if solution is None else solution[-2 * size : -size]


def _merit_value(theta: Vector, solution: ElasticSolution) -> float:
    return float(np.abs(theta).sum()) + solution.price


def coarse_grid(problem: CentroidalProblem) -> Grid:
    """The grid of the search for the unchanged problem."""
    return grid_of(problem, _interval_counts(problem, RATE_HZ, COARSE))


def grid_of(problem: CentroidalProblem, counts: Counts) -> Grid:
    """Grid with ``counts`` intervals per phase."""
    phase = np.repeat(np.arange(len(counts)), counts)
    h = problem.sequence.durations_s / counts
    return Grid(np.concatenate([[0.0], np.cumsum(h[phase])]), phase, h[phase])


def _interval_counts(problem: CentroidalProblem, rate_hz: float, least: int) -> Counts:
    return np.array([max(least, round(rate_hz * phase.duration_s)) for phase in problem.sequence.phases])


def _contact_wrench(lp: LinearConstraints, current: ElasticSolution, k: int, effector: str) -> Vector:
    """``(F, T)`` of a contact in interval ``k``, adhesion included."""
    i = int(lp.grid.phase[k])
    W, start = lp.wrenches[i, effector], lp.first[k, effector]
    return np.asarray(W @ (current.w[start : start + W.shape[1]] - current.sticks[i, effector]))


def _duration_derivatives(lp: LinearConstraints, problem: CentroidalProblem, current: ElasticSolution) -> sp.csc_matrix:
    """Derivative of the rows by the phase durations; the body limits do not depend on them."""
    J, phases = SparseBlocks(), problem.sequence.phases
    counts = np.bincount(lp.grid.phase)
    for k, h in enumerate(lp.grid.step_s):
        i, rate = int(lp.grid.phase[k]), _discrete_step_derivative(float(h))
        x = current.w[N_STATE * k : N_STATE * (k + 1)]
        wrench = sum((_contact_wrench(lp, current, k, name) for name in phases[i].contacts), np.zeros(6))
        J.add_block(N_STATE * k, i, -(rate.A @ x + rate.B @ wrench + rate.b)[:, None] / counts[i])
    return J.matrix(len(lp.b), len(phases))


def _placement_derivatives(
    lp: LinearConstraints, problem: CentroidalProblem, current: ElasticSolution, spans: list[ContactSpan], n_limits: int
) -> tuple[sp.csc_matrix, sp.csc_matrix]:
    """Derivatives of the rows and of the body limits, boxes first, by the shifts of the contacts."""
    J, H, row = SparseBlocks(), SparseBlocks(), 0
    movable_index = {
        (i, span.contact.effector): j for j, span in enumerate(spans) for i in range(span.first, span.last + 1)
    }
    axes = [DECIMETRE_M * span.contact.placement.rotation[:, :2] for span in spans]
    for k, h in enumerate(lp.grid.step_s):
        i, B = int(lp.grid.phase[k]), discrete_step(float(h)).B
        for name in problem.sequence.phases[i].contacts:
            if (i, name) in movable_index:
                j = movable_index[i, name]
                F = _contact_wrench(lp, current, k, name)[:3]
                J.add_block(N_STATE * k, 2 * j, B[:, 3:] @ skew(F) @ axes[j])
    for i, phase in enumerate(problem.sequence.phases):
        for name, contact in phase.contacts.items():
            if name not in problem.proxies:
                continue
            heading_rad = float(problem.sequence.headings_rad[i])
            R = problem.proxies[name].frame_placement(contact.placement, heading_rad).rotation
            for _ in range(int((lp.grid.phase == i).sum()) + 1):
                if (i, name) in movable_index:
                    j = movable_index[i, name]
                    H.add_block(row, 2 * j, -np.vstack([R.T, -R.T]) @ axes[j])
                row += 6
    return J.matrix(len(lp.b), 2 * len(spans)), H.matrix(n_limits, 2 * len(spans))


def _discrete_step_derivative(h: float) -> Step:
    """Derivative of ``dynamics.discrete_step`` by the length of the interval."""
    G, E, cross_g = GRAVITY_M_S2, np.eye(3), -skew(DOWN)
    A, B, b = np.zeros((N_STATE, N_STATE)), np.zeros((N_STATE, 6)), np.zeros(N_STATE)
    A[0:3, 3:6] = E
    A[6:9, 0:3], A[6:9, 3:6] = cross_g, h * cross_g
    B[0:3, 0:3], B[3:6, 0:3] = h * G * E, G * E
    B[6:9, 0:3], B[6:9, 3:6] = h**2 / 2 * G * cross_g, E
    b[0:3], b[3:6] = h * G * DOWN, G * DOWN
    return Step(A, B, b)
