"""Contact plans by trying every region for every step: a linear program per assignment, written for itself.

Prefixes that have no solution are not continued, which loses nothing.
"""

from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import linprog

from stridelab.contacts.planner.foothold_regions import Region
from stridelab.contacts.planner.schedule import RegionLookup, Schedule, StartAndGoal, build_schedule
from stridelab.contacts.planner.step_limits import BALL_COVER, DIRECTIONS, RobotLimits

FEASIBLE, NO_SOLUTION = 0, 2
Assignment = dict[int, Region]


def best_objective(
    ends: StartAndGoal, limits: RobotLimits, rooms: RegionLookup, steps: int, first: str
) -> float | None:
    """The least objective over all assignments of a walk without turns and without hands, None without any."""
    plan = build_schedule(ends, limits, rooms, steps, first)
    if plan is None:
        return None
    found = [_solved(plan, ends, limits, chosen, len(plan.feet)) for chosen in _assignments(plan, ends, limits)]
    return min((value for value in found if value is not None), default=None)


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
        low, high = limits.offset_box_m(now.effector)
        step = place(k) - place(k - 1)
        at_most(step, high)
        at_most(-step, -low)
        at_most(DIRECTIONS @ step, np.full(26, BALL_COVER * limits.feet_distance_max_m))
    for k in range(n):
        if plan.nodes[plan.feet[k]].fixed is None:
            off = np.zeros((2, 8 * n))
            off[:, 6 * n + 2 * k : 6 * n + 2 * k + 2] = np.eye(2)
            wanted = _even_m(ends, limits, k, len(plan.feet) - 1, plan.nodes[plan.feet[k]].effector)
            at_most(place(k)[:2] - off, wanted)
            at_most(-place(k)[:2] - off, -wanted)
    cost = np.concatenate([np.zeros(6 * n), np.ones(2 * n)])
    bounds = [(None, None)] * (6 * n) + [(0, None)] * (2 * n)
    found = linprog(
        cost, np.vstack(A), np.concatenate(b), np.vstack(equal), np.concatenate([np.ravel(v) for v in to]), bounds
    )
    assert found.status in {FEASIBLE, NO_SOLUTION}, found.message
    return float(found.fun) if found.status == FEASIBLE else None


def _even_m(ends: StartAndGoal, limits: RobotLimits, k: int, steps: int, effector: str) -> np.ndarray:
    """Place of the foot of step ``k``, level, for ends along x."""
    from_m, to_m = (np.mean([end[f].position_m[:2] for f in limits.feet], axis=0) for end in (ends.start, ends.goal))
    side = limits.defaults.width_m / 2 * (1.0 if effector == "left_foot" else -1.0)
    share = min(1.0, k / max(1, steps - 1))
    return np.asarray(from_m + share * (to_m - from_m) + [0.0, side])
