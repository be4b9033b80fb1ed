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

from stridelab.centroidal.dynamics import DOWN, N_STATE, Step, skew, step
from stridelab.centroidal.free_variables import Stay, movable
from stridelab.centroidal.infeasibility.body_limits import bodily
from stridelab.centroidal.infeasibility.elastic_lp import Relaxed, least, relax
from stridelab.centroidal.infeasibility.lp_constraints import Blocks, Rows, Vector, Where, missing, rows, sticking
from stridelab.centroidal.placement_windows import room_m
from stridelab.centroidal.problem import CentroidalProblem, Grid
from stridelab.contacts.sequence import ContactPhase, ContactSequence
from stridelab.conventions import GRAVITY_M_S2, Vector3

What = Literal["durations", "placements"]
Counts = Int[np.ndarray, "phases"]
PENALTY = 100.0
"""Price of slacks, per weight and second and per metre and second."""
SPARES = (0.1, 0.25, 0.5, 1.0)
"""Shares by which the smallest sufficient change is enlarged, tried in this order."""
RATE_HZ = 3.0
"""Nodes per second, fewer than in a plan: feasibility on a coarse grid implies it on a finer one."""
COARSE, FINE = 3, 5
"""Minimum intervals per phase in the search, and on the confirmation grid with twice as many nodes per second."""
SHORTEST_S = 0.05
DECIMETRE_M = 0.1
FARTHEST_M = 2.0
"""Maximum distance by which a contact may be moved."""
ROUNDS = 25
FIRST_REGION = 0.4
LAST_REGION = 1e-3


@dataclass(frozen=True, eq=False)
class Nearest:
    """A contact sequence near the given one.

    ``held``: whether its constraints and body limits are feasible. ``longer_s``: change of each phase's duration;
    ``shifts_m``: world-frame shifts of the contacts, by their first phase and effector.
    """

    sequence: ContactSequence
    held: bool
    longer_s: Vector
    shifts_m: dict[Where, Vector3]


def nearest(problem: CentroidalProblem, what: What, until_s: float = np.inf) -> Nearest | None:
    """Change the durations, or the placements of the contacts that begin and end within the motion.

    Returns None if there is nothing to change, or if the process time has already passed ``until_s``, at which the
    search ends.
    """
    counts = _counts(problem, RATE_HZ, COARSE)
    spans = movable(problem.sequence) if what == "placements" else []
    size = len(problem.sequence.phases) if what == "durations" else 2 * len(spans)
    limits = _limits(problem, what, spans)
    if time.process_time() > until_s:
        return None
    theta, region = np.zeros(size), FIRST_REGION
    current = _judged(problem, what, spans, theta, counts)
    if not size or current is None:
        return None
    for _ in range(ROUNDS):
        converged = current.price < LAST_REGION and region < FIRST_REGION and np.abs(theta).sum() < LAST_REGION
        if converged or time.process_time() > until_s:
            break
        candidate = _linear(problem, what, spans, theta, current, _Region(theta, region, limits), counts)
        candidate_solution = None if candidate is None else _judged(problem, what, spans, candidate, counts)
        if (
            candidate is None
            or candidate_solution is None
            or _merit(candidate, candidate_solution) > _merit(theta, current) - LAST_REGION / 10.0
        ):
            region /= 3.0
            if region < LAST_REGION:
                break
            continue
        theta, current, region = candidate, candidate_solution, min(FIRST_REGION, 1.5 * region)
    return _spared(problem, what, spans, theta, until_s)


def _spared(problem: CentroidalProblem, what: What, stays: list[Stay], theta: Vector, until_s: float) -> Nearest:
    """Enlarge the change by the smallest of ``RESERVES`` that is feasible on a finer grid, or the last one tried."""
    durations_s = np.array([phase.duration_s for phase in problem.sequence.phases])
    for reserve in SPARES if what == "durations" else SPARES[:1]:
        enlarged = (1.0 + reserve) * np.where(np.abs(theta) > LAST_REGION, theta, 0.0)
        changed = _changed(problem, what, stays, enlarged)
        fine = grid_of(changed, _counts(changed, 2.0 * RATE_HZ, FINE))
        final = relax(changed, cones=PENALTY, body=PENALTY, end=PENALTY, grid=fine)
        feasible = final is not None and final.held
        if feasible or time.process_time() > until_s:
            break
    return Nearest(
        changed.sequence,
        feasible,
        np.array([phase.duration_s for phase in changed.sequence.phases]) - durations_s,
        {
            (span.first, span.contact.effector): _shift(span, enlarged[2 * j : 2 * j + 2])
            for j, span in enumerate(stays)
            if enlarged[2 * j : 2 * j + 2].any()
        },
    )


@dataclass(frozen=True, eq=False)
class _Region:
    """Trust region of theta: a box of ``radius`` around ``at``, intersected with ``limits``."""

    at: Vector
    radius: float
    limits: tuple[Vector, Vector]

    @property
    def low(self) -> Vector:
        return np.asarray(np.maximum(self.at - self.radius, self.limits[0]))

    @property
    def high(self) -> Vector:
        return np.asarray(np.minimum(self.at + self.radius, self.limits[1]))


def _limits(problem: CentroidalProblem, what: What, stays: list[Stay]) -> tuple[Vector, Vector]:
    """Bounds of theta: phases last ``MIN_PHASE_S``; contacts stay within their windows, including the reserve."""
    if what == "durations":
        durations_s = np.array([phase.duration_s for phase in problem.sequence.phases])
        return np.minimum(0.0, SHORTEST_S - durations_s), np.full(len(durations_s), np.inf)
    windows = []
    for span in stays:
        points_m = problem.points_m(span.contact.effector)
        windows.append(room_m(span.contact, points_m, problem.sequence.terrain, (FARTHEST_M, FARTHEST_M)))
    low, high = (np.concatenate([np.zeros(0), *(room[side] for room in windows)]) for side in (0, 1))
    scale = (1.0 + SPARES[0]) * DECIMETRE_M
    return low / scale, high / scale


def _merit(theta: Vector, relaxed: Relaxed) -> float:
    return float(np.abs(theta).sum()) + relaxed.price


def coarse_grid(problem: CentroidalProblem) -> Grid:
    """The grid of the search for the unchanged problem."""
    return grid_of(problem, _counts(problem, RATE_HZ, COARSE))


def grid_of(problem: CentroidalProblem, counts: Counts) -> Grid:
    """Grid with ``counts`` intervals per phase."""
    phase = np.repeat(np.arange(len(counts)), counts)
    h = np.array([p.duration_s for p in problem.sequence.phases]) / counts
    return Grid(np.concatenate([[0.0], np.cumsum(h[phase])]), phase, h[phase])


def _counts(problem: CentroidalProblem, rate_hz: float, least: int) -> Counts:
    return np.array([max(least, round(rate_hz * phase.duration_s)) for phase in problem.sequence.phases])


def _judged(problem: CentroidalProblem, what: What, stays: list[Stay], theta: Vector, counts: Counts) -> Relaxed | None:
    changed = _changed(problem, what, stays, theta)
    return relax(changed, cones=PENALTY, body=PENALTY, end=PENALTY, grid=grid_of(changed, counts))


def _changed(problem: CentroidalProblem, what: What, stays: list[Stay], theta: Vector) -> CentroidalProblem:
    phases = list(problem.sequence.phases)
    if what == "durations":
        phases = [
            ContactPhase(max(SHORTEST_S, phase.duration_s + float(dt)), phase.contacts)
            for phase, dt in zip(phases, theta, strict=True)
        ]
    for j, span in enumerate(stays):
        old_placement, name = span.contact.placement, span.contact.effector
        placement = replace(old_placement, position_m=old_placement.position_m + _shift(span, theta[2 * j : 2 * j + 2]))
        for i in range(span.first, span.last + 1):
            contact = replace(span.contact, placement=placement)
            phases[i] = ContactPhase(phases[i].duration_s, {**phases[i].contacts, name: contact})
    return replace(problem, sequence=replace(problem.sequence, phases=tuple(phases)))


def _shift(stay: Stay, along: Vector) -> Vector3:
    return np.asarray(DECIMETRE_M * stay.contact.placement.rotation[:, :2] @ along)


def _linear(
    problem: CentroidalProblem,
    what: What,
    stays: list[Stay],
    theta: Vector,
    now: Relaxed,
    region: "_Region",
    counts: Counts,
) -> Vector | None:
    """Theta of the linear program linearised at the solution ``now``."""
    changed = _changed(problem, what, stays, theta)
    lp = rows(changed, grid_of(changed, counts))
    m, n = lp.A.shape
    _, sticks, seconds = sticking(lp, changed)
    G, limits = bodily(lp, changed, now.w[: N_STATE * (len(lp.grid.step_s) + 1)].reshape(-1, N_STATE))
    J, H = (
        (_by_durations(lp, changed, now), sp.csc_matrix((G.shape[0], len(theta))))
        if what == "durations"
        else _by_places(lp, changed, now, stays, G.shape[0])
    )
    durations_s = np.array([phase.duration_s for phase in changed.sequence.phases])
    slacks = PENALTY * np.concatenate([seconds, seconds, seconds, durations_s, np.ones(2 * lp.n_end)])
    size, count = len(theta), len(slacks)
    E, zero = sp.identity(size), sp.csc_matrix((size, n + count))
    no_columns = sp.csc_matrix((m, 2 * len(seconds) + len(durations_s)))
    miss, n_end = missing(lp), lp.n_end
    solution = least(
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
            np.concatenate([limits + H @ theta, np.zeros(2 * size)]),
        ),
        np.column_stack(
            [
                np.concatenate([lp.lower, np.zeros(count), region.low, np.zeros(size)]),
                np.concatenate([np.full(n + count, np.inf), region.high, np.full(size, np.inf)]),
            ]
        ),
    )
    return None if solution is None else solution[-2 * size : -size]


def _forces(programme: Rows, now: Relaxed, k: int, effector: str) -> Vector:
    """``(F, T)`` of a contact in interval ``k``, adhesion included."""
    i = int(programme.grid.phase[k])
    W, start = programme.wrenches[i, effector], programme.first[k, effector]
    return np.asarray(W @ (now.w[start : start + W.shape[1]] - now.sticks[i, effector]))


def _by_durations(programme: Rows, problem: CentroidalProblem, now: Relaxed) -> sp.csc_matrix:
    """Derivative of the rows by the phase durations; the body limits do not depend on them."""
    J, phases = Blocks(), problem.sequence.phases
    counts = np.bincount(programme.grid.phase)
    for k, h in enumerate(programme.grid.step_s):
        i, rate = int(programme.grid.phase[k]), _step_rate(float(h))
        x = now.w[N_STATE * k : N_STATE * (k + 1)]
        wrench = sum((_forces(programme, now, k, name) for name in phases[i].contacts), np.zeros(6))
        J.add(N_STATE * k, i, -(rate.A @ x + rate.B @ wrench + rate.b)[:, None] / counts[i])
    return J.matrix(len(programme.b), len(phases))


def _by_places(
    programme: Rows, problem: CentroidalProblem, now: Relaxed, stays: list[Stay], n_limits: int
) -> tuple[sp.csc_matrix, sp.csc_matrix]:
    """Derivatives of the rows and of the body limits, boxes first, by the shifts of the contacts."""
    J, H, row = Blocks(), Blocks(), 0
    movable_index = {
        (i, span.contact.effector): j for j, span in enumerate(stays) for i in range(span.first, span.last + 1)
    }
    axes = [DECIMETRE_M * span.contact.placement.rotation[:, :2] for span in stays]
    for k, h in enumerate(programme.grid.step_s):
        i, B = int(programme.grid.phase[k]), step(float(h)).B
        for name in problem.sequence.phases[i].contacts:
            if (i, name) in movable_index:
                j = movable_index[i, name]
                F = _forces(programme, now, k, name)[:3]
                J.add(N_STATE * k, 2 * j, B[:, 3:] @ skew(F) @ axes[j])
    for i, phase in enumerate(problem.sequence.phases):
        for name, contact in phase.contacts.items():
            if name not in problem.proxies:
                continue
            heading_rad = float(problem.sequence.headings_rad[i])
            R = problem.proxies[name].placement(contact.placement, heading_rad).rotation
            for _ in range(int((programme.grid.phase == i).sum()) + 1):
                if (i, name) in movable_index:
                    j = movable_index[i, name]
                    H.add(row, 2 * j, -np.vstack([R.T, -R.T]) @ axes[j])
                row += 6
    return J.matrix(len(programme.b), 2 * len(stays)), H.matrix(n_limits, 2 * len(stays))


def _step_rate(h: float) -> Step:
    """Derivative of ``dynamics.discrete_step`` by the length of the interval."""
    G, E, cross_g = GRAVITY_M_S2, np.eye(3), -skew(DOWN)
    A, B, b = np.zeros((N_STATE, N_STATE)), np.zeros((N_STATE, 6)), np.zeros(N_STATE)
    A[0:3, 3:6] = E
    A[6:9, 0:3], A[6:9, 3:6] = cross_g, h * cross_g
    B[0:3, 0:3], B[3:6, 0:3] = h * G * E, G * E
    B[6:9, 0:3], B[6:9, 3:6] = h**2 / 2 * G * cross_g, E
    b[0:3], b[3:6] = h * G * DOWN, G * DOWN
    return Step(A, B, b)
