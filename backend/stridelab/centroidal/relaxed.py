"""The constraints of (4.20) alone, relaxed until they have a solution: linear programmes.

In the variables of ``dynamics`` the constraints of u_f are linear, so that what a solver failed at can be decided.
Where the cones are in the way, every contact of a phase may stick to its surface by one ray length ``s`` throughout,

    min  sum over phases and effectors of  T s     s.t.  A w = b,   lambda >= -s,   s >= 0                (cones)

and where the goal is, the end may be missed by ``e``:

    min  |e|_1                                     s.t.  A w = b + e at the end,   lambda >= 0            (end)

A sum of absolute values is met with few of them, so the first names few phases. With n rays per point, ``lambda >= -s``
moves the point's pyramid down by ``n s``: its margin, as ``contacts.wrench_margin`` has it, is ``-mu cos(pi / n) n s``.
No cost and no density is part of this: a programme with a solution can still be a motion that no leg follows.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float
from scipy.optimize import linprog

from stridelab.centroidal.blocks import Blocks
from stridelab.centroidal.dynamics import DOWN, N_STATE, step
from stridelab.centroidal.problem import CentroidalProblem, Grid
from stridelab.contacts.point_contacts import PointContacts
from stridelab.conventions import Vector3
from stridelab.errors import NotEstimable

HELD: float = 1e-6
"""Share of the weight by which forces may leave their cones in a programme that still counts as solvable."""
N_RAYS = 8
"""Rays of the pyramid inside each friction cone."""
N_END = 3 + N_STATE
"""Rows of the end: no acceleration; at the goal, at rest, without angular momentum."""

Vector = Float[np.ndarray, "_"]
Where = tuple[int, str]
"""A contact: its phase and its effector."""


@dataclass(frozen=True, eq=False)
class EndMiss:
    """By how much the best motion misses the end: CoM, its velocity and acceleration, angular momentum about it."""

    com_m: Vector3
    velocity_m_s: Vector3
    acceleration_m_s2: Vector3
    momentum_nms: Vector3

    @property
    def met(self) -> bool:
        """Whether the end is reached."""
        parts = (self.com_m, self.velocity_m_s, self.acceleration_m_s2, self.momentum_nms)
        return bool(max(np.abs(part).max() for part in parts) < 1e-5)


@dataclass(frozen=True, eq=False)
class Rows:
    """``A w = b``, ``w >= lower``: states ``(n + 1, 9)`` first, then the ray lengths of every interval and contact.

    ``first[k, effector]`` is where those of interval ``k`` begin; positions are relative to the CoM at the start.
    """

    grid: Grid
    wrenches: Mapping[Where, Float[np.ndarray, "6 _"]]
    first: Mapping[Where, int]
    A: sp.csc_matrix
    b: Vector
    lower: Vector


def rays(problem: CentroidalProblem, phase: int, effector: str) -> Float[np.ndarray, "6 m"]:
    """``(F, T)`` about the CoM at the start per unit length of every ray of a contact, point by point."""
    contact = problem.contact(effector, phase)
    points_m = contact.placement.act(problem.points_m(effector)) - problem.com_start_m
    n = len(points_m)
    same = np.broadcast_to(contact.placement.rotation, (n, 3, 3))
    return PointContacts(points_m, same, np.full(n, contact.friction)).rays(N_RAYS).T


def rows(problem: CentroidalProblem, grid: Grid) -> Rows:
    """The constraints on a grid; the last ``N_END`` rows are the end, the ``N_STATE`` before them the start."""
    phases, last = problem.sequence.phases, len(grid.step_s) - 1
    wrenches = {(i, name): rays(problem, i, name) for i, phase in enumerate(phases) for name in phase.contacts}
    n, first = N_STATE * (last + 2), dict[Where, int]()
    for k, i in enumerate(grid.phase.tolist()):
        for name in phases[i].contacts:
            first[k, name] = n
            n += wrenches[i, name].shape[1]
    A, b = Blocks(), []
    for k, h in enumerate(grid.step_s):
        s, i, row = step(float(h)), int(grid.phase[k]), N_STATE * k
        A.add(row, N_STATE * (k + 1), np.eye(N_STATE))
        A.add(row, N_STATE * k, -s.A)
        b.append(s.b)
        for name in phases[i].contacts:
            A.add(row, first[k, name], -s.B @ wrenches[i, name])
    start = N_STATE * (last + 1)
    A.add(start, 0, np.eye(N_STATE))
    end = start + N_STATE
    for name in phases[-1].contacts:
        A.add(end, first[last, name], wrenches[len(phases) - 1, name][:3])
    A.add(end + 3, N_STATE * (last + 1), np.eye(N_STATE))
    goal = np.concatenate([problem.com_end_m - problem.com_start_m, np.zeros(6)])
    b += [np.zeros(N_STATE), -DOWN, goal]
    lower = np.full(n, -np.inf)
    lower[N_STATE * (last + 2) :] = 0.0
    return Rows(grid, wrenches, first, A.matrix(end + N_END, n), np.concatenate(b), lower)


def sticking(programme: Rows, problem: CentroidalProblem) -> tuple[list[Where], sp.csc_matrix, Vector]:
    """Contacts, the columns of their ``s`` in ``A``, and the seconds for which each may stick."""
    where = [(i, name) for i, phase in enumerate(problem.sequence.phases) for name in phase.contacts]
    columns, seconds, last = Blocks(), np.zeros(len(where)), len(programme.grid.step_s) - 1
    for j, (i, name) in enumerate(where):
        pull = programme.wrenches[i, name].sum(axis=1)[:, None]
        for k in np.flatnonzero(programme.grid.phase == i):
            h = float(programme.grid.step_s[k])
            seconds[j] += h
            columns.add(N_STATE * int(k), j, step(h).B @ pull)
            if k == last:
                columns.add(N_STATE * (last + 2), j, -pull[:3])
    return where, columns.matrix(len(programme.b), len(where)), seconds


def cone_margins_n(problem: CentroidalProblem) -> Mapping[Where, float]:
    """The margin (N) that each contact of each phase is left with when the cones give as little as possible.

    Zero where the contact's own cone is enough, negative where it is not. Raises ``NotEstimable``
    ("relaxed-problem-unsolved") where not even contacts that stick lead to the goal (nothing touches).
    """
    programme = rows(problem, problem.grid())
    where, columns, seconds = sticking(programme, problem)
    n = len(programme.lower)
    w = least(
        np.concatenate([np.zeros(n), seconds]),
        sp.hstack([programme.A, columns], format="csc"),
        programme.b,
        np.concatenate([programme.lower, np.zeros(len(where))]),
    )
    if w is None:
        raise NotEstimable(
            "relaxed-problem-unsolved", "Too little touches to lead the robot to its goal, even if it stuck there."
        )
    lengths = np.where(w[n:] > HELD, w[n:], 0.0)
    face = N_RAYS * np.cos(np.pi / N_RAYS) * problem.weight_n
    return {at: -float(problem.contact(at[1], at[0]).friction * face * s) for at, s in zip(where, lengths, strict=True)}


def held(problem: CentroidalProblem) -> bool:
    """Whether the constraints have a solution at all."""
    try:
        return all(margin == 0.0 for margin in cone_margins_n(problem).values())
    except NotEstimable:
        return False


def end_miss(problem: CentroidalProblem) -> EndMiss:
    """How near to the goal, and to rest there, forces inside their cones lead.

    A metre, a metre per second, the weight (per mass) and a metre times the weight times a second count the same.
    """
    programme = rows(problem, problem.grid())
    m, n = programme.A.shape
    miss = sp.vstack([sp.csc_matrix((m - N_END, N_END)), sp.identity(N_END)], format="csc")
    w = least(
        np.concatenate([np.zeros(n), np.ones(2 * N_END)]),
        sp.hstack([programme.A, miss, -miss], format="csc"),
        programme.b,
        np.concatenate([programme.lower, np.zeros(2 * N_END)]),
    )
    if w is None:  # falling freely misses the goal, but is a solution
        raise NotEstimable("relaxed-problem-unsolved", "The linear programme of the relaxed end failed.")
    e = w[n + N_END :] - w[n : n + N_END]
    goal = problem.com_end_m - problem.com_start_m
    com, velocity, K = e[3:6], e[6:9], e[9:12]
    momentum = problem.weight_n * K - problem.mass_kg * np.cross(goal + com, velocity)
    return EndMiss(com, velocity, e[0:3] * problem.weight_n / problem.mass_kg, momentum)


def least(cost: Vector, A: sp.csc_matrix, b: Vector, lower: Vector, upper: Vector | None = None) -> Vector | None:
    """``min cost w`` over ``A w = b`` and the bounds; None where there is no solution."""
    most = np.full(len(lower), np.inf) if upper is None else upper
    found = linprog(cost, A_eq=A, b_eq=b, bounds=np.column_stack([lower, most]), method="highs")
    return None if found.x is None else np.asarray(found.x)
