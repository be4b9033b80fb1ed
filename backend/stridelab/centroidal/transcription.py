"""The problem as a nonlinear programme in which only the objective is not linear.

The variables are those of ``layout``. Rows, all of them equalities ``A w = b``, interval by interval:

    x_{k+1} - A x_k - B (F, T)_k = b                                 (4.8) by the exact step of ``dynamics``
    (F, T)_k - sum over points of (V lambda, p x V lambda) = 0       (4.2)

then the boundary values; ``lambda >= 0`` is the friction cone. The wrench as a variable of its own keeps the curvature
of the objective, which knows forces by their wrench only, to 12 x 12 per interval whatever the number of points.
"""

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float

from stridelab.centroidal.cone import N_RAYS, rays
from stridelab.centroidal.dynamics import DOWN, N_STATE, N_WRENCH, skew, step
from stridelab.centroidal.layout import Layout, lay_out
from stridelab.centroidal.objective import Objective, objective
from stridelab.centroidal.problem import CentroidalProblem, Grid
from stridelab.centroidal.sparse import Blocks
from stridelab.contacts.sequence import Contact
from stridelab.conventions import Series, Vector3


@dataclass(frozen=True, eq=False)
class Transcription:
    """``min objective(w)  s.t.  A w = b,  w >= lower``.

    Positions inside are relative to ``origin_m``, the CoM at the start; forces are in units of m |g|. ``guess`` is the
    thesis' own start: a straight CoM path, at rest everywhere, the weight shared equally by the points. ``stage_rows``
    counts the rows of every node that do not lead to the next one.
    """

    problem: CentroidalProblem
    grid: Grid
    layout: Layout
    origin_m: Vector3
    A: sp.csc_matrix
    b: Float[np.ndarray, "rows"]
    lower: Series
    guess: Series
    stage_rows: tuple[int, ...]
    objective: Objective

    def states(self, w: Series) -> Float[np.ndarray, "nodes 9"]:
        """``x_k`` of all nodes."""
        return np.asarray(w[self.layout.state[:, None] + np.arange(N_STATE)])


def transcribe(problem: CentroidalProblem) -> Transcription:
    """Build the programme."""
    grid = problem.grid()
    layout = lay_out(problem, grid)
    origin = problem.com_start_m
    wrenches = {
        (i, name): wrench_of_rays(problem, contact, origin)
        for i, phase in enumerate(problem.sequence.phases)
        for name, contact in phase.contacts.items()
    }
    A, b, stage_rows = _rows(problem, grid, layout, wrenches)
    lower = np.full(layout.n, -np.inf)
    for effector, starts in layout.ray.items():
        size = N_RAYS * len(problem.points_m(effector))
        for start in starts.values():
            lower[start : start + size] = 0.0
    return Transcription(
        problem=problem,
        grid=grid,
        layout=layout,
        origin_m=origin,
        A=A,
        b=b,
        lower=lower,
        guess=_guess(problem, grid, layout, wrenches),
        stage_rows=stage_rows,
        objective=objective(problem, grid, layout, origin),
    )


Wrenches = dict[tuple[int, str], np.ndarray]


def wrench_of_rays(problem: CentroidalProblem, contact: Contact, origin_m: Vector3) -> Float[np.ndarray, "6 m"]:
    """``(F, T)`` about the origin per unit length of every ray of a contact, all points one after the other."""
    R, p = contact.placement.rotation, contact.placement.position_m - origin_m
    V = R @ rays(contact.friction)
    points = p + problem.points_m(contact.effector) @ R.T
    return np.hstack([np.vstack([V, skew(q) @ V]) for q in points])


def _rows(
    problem: CentroidalProblem, grid: Grid, layout: Layout, wrenches: Wrenches
) -> tuple[sp.csc_matrix, Series, tuple[int, ...]]:
    """All equalities in the order that stage-wise solvers expect: per interval gap, boundary, wrench."""
    A, b, row = Blocks(), [], 0
    stage_rows: list[int] = []
    last = len(grid.step_s) - 1
    for k, h in enumerate(grid.step_s):
        s, phase = step(float(h)), int(grid.phase[k])
        x, w = int(layout.state[k]), int(layout.wrench[k])
        A.add(row, int(layout.state[k + 1]), np.eye(N_STATE))
        A.add(row, x, -s.A)
        A.add(row, w, -s.B)
        b.append(s.b)
        row += N_STATE
        first = row
        if k == 0:
            A.add(row, x, np.eye(N_STATE))
            b.append(np.zeros(N_STATE))
            row += N_STATE
        A.add(row, w, np.eye(N_WRENCH))
        for name in problem.sequence.phases[phase].contacts:
            A.add(row, layout.ray[name][k], -wrenches[phase, name])
        b.append(np.zeros(N_WRENCH))
        row += N_WRENCH
        if k == last:  # rest that stays rest
            A.add(row, w, np.eye(3))
            b.append(-DOWN)
            row += 3
        stage_rows.append(row - first)
    A.add(row, int(layout.state[-1]), np.eye(N_STATE))
    b.append(np.concatenate([problem.com_end_m - problem.com_start_m, np.zeros(6)]))
    row += N_STATE
    return A.matrix((row, layout.n)), np.concatenate(b), (*stage_rows, N_STATE)


def _guess(problem: CentroidalProblem, grid: Grid, layout: Layout, wrenches: Wrenches) -> Series:
    w = np.zeros(layout.n)
    share = grid.time_s / grid.time_s[-1]
    w[layout.state[:, None] + np.arange(3)] = share[:, None] * (problem.com_end_m - problem.com_start_m)
    for k, phase in enumerate(grid.phase):
        contacts = problem.sequence.phases[int(phase)].contacts
        n_rays = sum(wrenches[int(phase), name].shape[1] for name in contacts)
        for name in contacts:
            M, start = wrenches[int(phase), name], layout.ray[name][k]
            w[start : start + M.shape[1]] = 1.0 / n_rays
            w[layout.wrench[k] + np.arange(N_WRENCH)] += M.sum(axis=1) / n_rays
    return w
