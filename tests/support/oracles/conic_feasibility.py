"""Whether a motion exists at all: a second-order cone programme of the linear form, by Clarabel.

With z = (c, c', kappa), kappa = K / (m |g|) about the CoM's start, and forces F_i in m |g|, constant over h,

    c'+ = c' + h a,   c+ = c + h c' + h^2 a / 2,   a = |g| (sum F_i - e_z)
    kappa+ = kappa + h sum p_i x F_i - (h c + h^2 c' / 2 + h^3 a / 6) x e_z
    |F_t,i| <= mu_i F_n,i,   z_0 and z_N as given,   the last a zero

Nothing here knows of a cost but the sum of squares of the forces, nor of the planner's arrays.
"""

from typing import Literal

import clarabel
import numpy as np
from scipy import sparse

from stridelab.centroidal.problem import CentroidalProblem
from stridelab.conventions import GRAVITY_M_S2

Answer = Literal["feasible", "infeasible", "unknown"]
STATE, UP = 9, np.array([0.0, 0.0, 1.0])
ANSWERS: dict[str, Answer] = {
    "Solved": "feasible",
    "AlmostSolved": "feasible",
    "PrimalInfeasible": "infeasible",
    "AlmostPrimalInfeasible": "infeasible",
}


def cross_matrix(p):
    x, y, z = p
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def step_matrices(h):
    """A, B of (F, T) summed over the points, and what gravity adds."""
    A, B = np.eye(STATE), np.zeros((STATE, 6))
    eye, turn = np.eye(3), cross_matrix(UP)  # -x cross e_z = e_z cross x
    A[0:3, 3:6] = h * eye
    A[6:9, 0:3], A[6:9, 3:6] = h * turn, h * h / 2 * turn
    B[0:3, 0:3], B[3:6, 0:3] = GRAVITY_M_S2 * h * h / 2 * eye, GRAVITY_M_S2 * h * eye
    B[6:9, 0:3], B[6:9, 3:6] = GRAVITY_M_S2 * h**3 / 6 * turn, h * eye
    return A, B, -B[:, 2]


def exists(problem: CentroidalProblem) -> Answer:
    """Whether any forces in their cones lead a motion from the start of ``problem`` to rest at its end."""
    assert problem.terminal == "rest"
    assert problem.bounds.com_height_m is None
    grid, origin = problem.grid(), problem.com_start_m
    most = {name: f / problem.weight_n for name, f in problem.bounds.normal_force_max_n.items()}
    start = np.concatenate([np.zeros(3), problem.start.com_v_m_s, problem.start.l_nms / problem.weight_n])
    goal = np.concatenate([problem.com_end_m - origin, np.zeros(6)])
    rows, columns, values, right = [], [], [], []
    cone_rows, cone_columns, cone_values, cone_right = [], [], [], []

    def put(matrix, at_row, at_column):
        r, c = np.nonzero(matrix)
        rows.append(r + at_row)
        columns.append(c + at_column)
        values.append(matrix[r, c])

    intervals = len(grid.phase)
    column = STATE * (intervals + 1)
    put(np.eye(STATE), 0, 0)
    right.append(start)
    row = STATE
    pushed, soc = [], []
    for k, (phase, h) in enumerate(zip(grid.phase.tolist(), grid.step_s.tolist(), strict=True)):
        A, B, drop = step_matrices(h)
        put(A, row, STATE * k)
        put(-np.eye(STATE), row, STATE * (k + 1))
        right.append(-drop)
        last = k == intervals - 1
        if last:
            right.append(UP)
        for touch in problem.contact_patches(phase, origin):
            for p in touch.points_m:
                put(B @ np.vstack([np.eye(3), cross_matrix(p)]), row, column)
                if last:
                    put(np.eye(3), row + STATE, column)
                soc.append((column, touch.rotation, touch.friction))
                if touch.effector in most:
                    pushed.append((column, touch.rotation[:, 2], most[touch.effector]))
                column += 3
        row += STATE + 3 * last
    put(np.eye(STATE), row, STATE * intervals)
    right.append(goal)
    row += STATE
    at = 0
    for first, normal, bound in pushed:
        cone_rows += [at] * 3
        cone_columns += [first, first + 1, first + 2]
        cone_values += normal.tolist()
        cone_right.append(bound)
        at += 1
    bounded = at
    for first, rotation, friction in soc:
        G = -(rotation * np.array([1.0, 1.0, friction])).T[[2, 0, 1]]
        for i in range(3):
            cone_rows += [at + i] * 3
            cone_columns += [first, first + 1, first + 2]
            cone_values += G[i].tolist()
        cone_right += [0.0] * 3
        at += 3
    equal = sparse.csc_matrix(
        (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))), shape=(row, column)
    )
    inside = sparse.csc_matrix((cone_values, (cone_rows, cone_columns)), shape=(at, column))
    cones = [clarabel.ZeroConeT(row)]
    cones += [clarabel.NonnegativeConeT(bounded)] if bounded else []
    cones += [clarabel.SecondOrderConeT(3)] * len(soc)
    effort = np.zeros(column)
    effort[STATE * (intervals + 1) :] = 1e-3
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.max_threads = 1
    found = clarabel.DefaultSolver(
        sparse.diags(effort).tocsc(),
        np.zeros(column),
        sparse.vstack([equal, inside]).tocsc(),
        np.concatenate([*right, cone_right]),
        cones,
        settings,
    ).solve()
    return ANSWERS.get(str(found.status), "unknown")
