"""The constraints of (4.20) as rows ``A w = b``, ``w >= lower``, for linear programs.

``w`` holds the states of ``dynamics`` at all nodes, then the lengths of the rays of every interval and contact:

    x_{k+1} - A x_k - B sum V lambda = b                              every interval
    x_0 = the start
    F = the weight,  x_N = (goal, 0, 0)                               at an end at rest
    x_N = the state of the goal                                       at a moving one
    c_z, c_z' = (goal, 0),  n (c + c' / omega) <= b                   at a capturable one
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float, Int

from stridelab.centroidal.contact_wrench import DOWN, N_STATE, discrete_step
from stridelab.centroidal.problem import CentroidalProblem, Grid
from stridelab.contacts.wrench_cones.contact_points import PointContacts

N_RAYS = 8
"""Rays of the pyramid inside each friction cone."""

Vector = Float[np.ndarray, "_"]
States = Float[np.ndarray, "_ 9"]
Where = tuple[int, str]
"""A contact: its phase and its effector."""


@dataclass(frozen=True, eq=False)
class LinearConstraints:
    """``A w = b``, ``w >= lower``: states ``(n + 1, 9)`` first, then the ray lengths of every interval and contact.

    ``first[k, effector]`` is the index of the first ray length of interval ``k``; positions are relative to the CoM at
    the start. The last ``n_end`` rows are the end conditions, the ``N_STATE`` before them the start.
    """

    grid: Grid
    wrenches: Mapping[Where, Float[np.ndarray, "6 _"]]
    first: Mapping[Where, int]
    n_end: int
    A: sp.csc_matrix
    b: Vector
    lower: Vector


def linear_constraints(problem: CentroidalProblem, grid: Grid) -> LinearConstraints:
    """The constraints of a problem on a grid."""
    phases, last = problem.sequence.phases, len(grid.step_s) - 1
    wrenches = {(i, name): ray_wrenches(problem, i, name) for i, phase in enumerate(phases) for name in phase.contacts}
    n, first = N_STATE * (last + 2), dict[Where, int]()
    for k, i in enumerate(grid.phase.tolist()):
        for name in phases[i].contacts:
            first[k, name] = n
            n += wrenches[i, name].shape[1]
    A, b = SparseBlocks(), []
    for k, h in enumerate(grid.step_s):
        s, i, row = discrete_step(float(h)), int(grid.phase[k]), N_STATE * k
        A.add_block(row, N_STATE * (k + 1), np.eye(N_STATE))
        A.add_block(row, N_STATE * k, -s.A)
        b.append(s.b)
        for name in phases[i].contacts:
            A.add_block(row, first[k, name], -s.B @ wrenches[i, name])
    start = N_STATE * (last + 1)
    A.add_block(start, 0, np.eye(N_STATE))
    b.append(np.concatenate([np.zeros(3), problem.start.com_v_m_s, problem.start.l_nms / problem.weight_n]))
    end, at_end, goal = start + N_STATE, N_STATE * (last + 1), problem.com_end_m - problem.com_start_m
    stop = problem.capture_region()
    if stop is not None:  # its momentum is limited by the body limits only
        A.add_block(end, at_end, np.eye(N_STATE)[[2, 5]])
        planes = len(stop.offsets)
        over = np.zeros((planes, N_STATE))
        over[:, 0:2], over[:, 3:5] = stop.normals, stop.normals / stop.omega_1_s
        A.add_block(end + 2, at_end, over)
        A.add_block(end + 2, n, np.eye(planes))  # slack to the planes, non-negative
        b.append(np.concatenate([goal[2:], [0.0], stop.offsets]))
        n, n_end = n + planes, 2 + planes
    elif problem.terminal == "moving":
        A.add_block(end, at_end, np.eye(N_STATE))
        b.append(problem.end_state())
        n_end = N_STATE
    else:
        for name in phases[-1].contacts:
            A.add_block(end, first[last, name], wrenches[len(phases) - 1, name][:3])
        A.add_block(end + 3, at_end, np.eye(N_STATE))
        b += [-DOWN, problem.end_state()]
        n_end = 3 + N_STATE
    lower = np.full(n, -np.inf)
    lower[N_STATE * (last + 2) :] = 0.0
    return LinearConstraints(grid, wrenches, first, n_end, A.matrix(end + n_end, n), np.concatenate(b), lower)


def ray_wrenches(problem: CentroidalProblem, phase: int, effector: str) -> Float[np.ndarray, "6 m"]:
    """``(F, T)`` about the CoM at the start per unit length of every ray of a contact, point by point."""
    contact = problem.contact(effector, phase)
    points_m = contact.placement.act(problem.points_m(effector)) - problem.com_start_m
    n = len(points_m)
    same = np.broadcast_to(contact.placement.rotation, (n, 3, 3))
    return PointContacts(points_m, same, np.full(n, problem.usable_friction(effector, phase))).wrench_rays(N_RAYS).T


def adhesion_columns(lp: LinearConstraints, problem: CentroidalProblem) -> tuple[list[Where], sp.csc_matrix, Vector]:
    """All contacts, the columns of their slacks ``s`` in ``A``, and the duration (s) of each."""
    contacts = [(i, name) for i, phase in enumerate(problem.sequence.phases) for name in phase.contacts]
    columns, seconds, last = SparseBlocks(), np.zeros(len(contacts)), len(lp.grid.step_s) - 1
    for j, (i, name) in enumerate(contacts):
        pull = lp.wrenches[i, name].sum(axis=1)[:, None]
        for k in np.flatnonzero(lp.grid.phase == i):
            h = float(lp.grid.step_s[k])
            seconds[j] += h
            columns.add_block(N_STATE * int(k), j, discrete_step(h).B @ pull)
            if k == last and problem.terminal == "rest":
                columns.add_block(N_STATE * (last + 2), j, -pull[:3])
    return contacts, columns.matrix(len(lp.b), len(contacts)), seconds


def end_slack_columns(lp: LinearConstraints) -> sp.csc_matrix:
    """Columns of the end slacks ``e`` in ``A``."""
    n_end = lp.n_end
    return sp.vstack([sp.csc_matrix((len(lp.b) - n_end, n_end)), sp.identity(n_end)], format="csc")


@dataclass(frozen=True)
class SparseBlocks:
    """A sparse matrix under construction, block by block; overlapping entries are added."""

    rows: list[Int[np.ndarray, "_"]] = field(default_factory=list)
    columns: list[Int[np.ndarray, "_"]] = field(default_factory=list)
    values: list[Float[np.ndarray, "_"]] = field(default_factory=list)

    def add_block(self, row: int, column: int, M: Float[np.ndarray, "rows columns"]) -> None:
        """Add ``M`` with its upper left corner at ``(row, column)``."""
        i, j = np.nonzero(M)
        self.rows.append(row + i)
        self.columns.append(column + j)
        self.values.append(M[i, j])

    def matrix(self, n_rows: int, n_columns: int) -> sp.csc_matrix:
        """The finished matrix."""
        if not self.values:
            return sp.csc_matrix((n_rows, n_columns))
        places = np.concatenate(self.rows), np.concatenate(self.columns)
        return sp.csc_matrix((np.concatenate(self.values), places), shape=(n_rows, n_columns))
