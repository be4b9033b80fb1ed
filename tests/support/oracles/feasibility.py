"""Whether a motion or a sequence of contacts exists at all, by solvers that the product does not use for it.

Whether a motion exists at all: a second-order cone programme of the linear form, by Clarabel.

With z = (c, c', kappa), kappa = K / (m |g|) about the CoM's start, and forces F_i in m |g|, constant over h,

    c'+ = c' + h a,   c+ = c + h c' + h^2 a / 2,   a = |g| (sum F_i - e_z)
    kappa+ = kappa + h sum p_i x F_i - (h c + h^2 c' / 2 + h^3 a / 6) x e_z
    |F_t,i| <= mu_i F_n,i,   z_0 and z_N as given,   the last a zero

Nothing here knows of a cost but the sum of squares of the forces, nor of the planner's arrays.

Contact plans by trying every region for every step: a linear program per assignment, written for itself.

Prefixes that have no solution are not continued, which loses nothing.
"""

from collections.abc import Iterator
from typing import Literal

import clarabel
import numpy as np
from numpy.typing import ArrayLike
from scipy import sparse
from scipy.optimize import linprog

from stridelab.centroidal.problem import CentroidalProblem
from stridelab.contacts.planner.foothold_regions import Region
from stridelab.contacts.planner.schedule import RegionLookup, Schedule, StartAndGoal, build_schedule
from stridelab.contacts.planner.step_limits import BALL_COVER, DIRECTIONS, RobotLimits
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


def motion_exists(problem: CentroidalProblem) -> Answer:
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
    solver = clarabel.DefaultSolver(
        sparse.diags(effort).tocsc(),
        np.zeros(column),
        sparse.vstack([equal, inside]).tocsc(),
        np.concatenate([*right, cone_right]),
        cones,
        settings,
    ).solve()
    return ANSWERS.get(str(solver.status), "unknown")


FEASIBLE, NO_SOLUTION = 0, 2
Assignment = dict[int, Region]


def best_objective(
    ends: StartAndGoal, limits: RobotLimits, rooms: RegionLookup, steps: int, first: str
) -> float | None:
    """The least objective over all assignments of a walk without turns and without hands, None without any."""
    plan = build_schedule(ends, limits, rooms, steps, first)
    if plan is None:
        return None
    objectives = [_solved(plan, ends, limits, chosen, len(plan.feet)) for chosen in _assignments(plan, ends, limits)]
    return min((value for value in objectives if value is not None), default=None)


def _assignments(plan: Schedule, ends: StartAndGoal, limits: RobotLimits) -> Iterator[Assignment]:
    open_: list[tuple[int, Assignment]] = [(0, {})]
    while open_:
        k, chosen = open_.pop()
        if _solved(plan, ends, limits, chosen, k) is None:
            continue
        if k == len(plan.feet):
            yield chosen
            continue
        node = plan.nodes[plan.feet[k]]
        choices = [chosen] if node.fixed is not None else [{**chosen, k: region} for region in node.choices]
        open_ += [(k + 1, more) for more in choices]


def _solved(plan: Schedule, ends: StartAndGoal, limits: RobotLimits, chosen: Assignment, count: int) -> float | None:
    """The program of the first ``count`` feet of the chain: places ``p_k``, one CoM and two deviations per step."""
    if count < 2:
        return 0.0
    n = count
    A: list[np.ndarray] = []
    b: list[np.ndarray] = []
    equal: list[np.ndarray] = []
    to: list[np.ndarray] = []

    def place(k: int) -> np.ndarray:
        rows = np.zeros((3, 8 * n))
        rows[:, 3 * k : 3 * k + 3] = np.eye(3)
        return rows

    def com(k: int) -> np.ndarray:
        rows = np.zeros((3, 8 * n))
        rows[:, 3 * n + 3 * k : 3 * n + 3 * k + 3] = np.eye(3)
        return rows

    def at_most(rows: np.ndarray, values: ArrayLike) -> None:
        A.append(np.atleast_2d(rows))
        b.append(np.atleast_1d(values))

    for k in range(n):
        node = plan.nodes[plan.feet[k]]
        if node.fixed is not None:
            equal.append(place(k))
            to.append(node.fixed.position_m)
            continue
        region = chosen[k]
        local, normal = region.axes, np.cross(region.axes[:, 0], region.axes[:, 1])
        equal.append(normal @ place(k))
        to.append(np.array([normal @ region.origin_m]))
        at_most(region.A @ local.T @ place(k), region.b + region.A @ local.T @ region.origin_m)
    for k in range(1, n):
        now, before = plan.nodes[plan.feet[k]], plan.nodes[plan.feet[k - 1]]
        both = now.fixed is not None and before.fixed is not None
        if not both:
            for i, node in ((k, now), (k - 1, before)):
                reach = limits.effectors[node.effector].heading
                at_most(com(k) - place(i), reach.com_high_m)
                at_most(place(i) - com(k), -np.array(reach.com_low_m))
                at_most(DIRECTIONS @ (com(k) - place(i)), np.full(26, BALL_COVER * reach.com_distance_max_m))
        if both and k == len(plan.feet) - 1:
            continue
        low, high = limits.offset_box_m(now.effector, now.yaw_rad - before.yaw_rad)
        step = place(k) - place(k - 1)
        at_most(step, high)
        at_most(-step, -low)
        at_most(DIRECTIONS @ step, np.full(26, BALL_COVER * limits.feet_distance_max_m))
        shorter = limits.length_per_rise(now.effector)
        for up in (shorter, -shorter):
            at_most(np.stack([step[0] + up * step[2], -step[0] + up * step[2]]), [high[0], -low[0]])
    start = plan.nodes[plan.walk[0]].fixed  # of the foot that moves first
    assert start is not None
    for k in range(1, n):
        up = place(k)[2] - place(k - 2)[2] if k > 1 else place(k)[2]
        base = 0.0 if k > 1 else start.position_m[2]
        at_most(np.stack([up, -up]), [limits.defaults.rise_max_m + base, limits.defaults.rise_max_m - base])
    for k in range(n):
        if plan.nodes[plan.feet[k]].fixed is None:
            off = np.zeros((2, 8 * n))
            off[:, 6 * n + 2 * k : 6 * n + 2 * k + 2] = np.eye(2)
            target_m = _even_m(ends, limits, k, len(plan.feet) - 1, plan.nodes[plan.feet[k]].effector)
            at_most(place(k)[:2] - off, target_m)
            at_most(-place(k)[:2] - off, -target_m)
    cost = np.concatenate([np.zeros(6 * n), np.ones(2 * n)])
    bounds = [(None, None)] * (6 * n) + [(0, None)] * (2 * n)
    solution = linprog(
        cost, np.vstack(A), np.concatenate(b), np.vstack(equal), np.concatenate([np.ravel(v) for v in to]), bounds
    )
    assert solution.status in {FEASIBLE, NO_SOLUTION}, solution.message
    return float(solution.fun) if solution.status == FEASIBLE else None


def _even_m(ends: StartAndGoal, limits: RobotLimits, k: int, steps: int, effector: str) -> np.ndarray:
    """Place of the foot of step ``k``, level, for ends along x."""
    from_m, to_m = (np.mean([end[f].position_m[:2] for f in limits.feet], axis=0) for end in (ends.start, ends.goal))
    side = limits.defaults.width_m / 2 * (1.0 if effector == "left_foot" else -1.0)
    share = min(1.0, k / max(1, steps - 1))
    return np.asarray(from_m + share * (to_m - from_m) + [0.0, side])
