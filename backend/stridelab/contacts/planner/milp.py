"""The mixed-integer linear program of a step schedule, solved by scipy's HiGHS.

It selects the region of every placement and its position in that region.

Placement ``i`` with regions ``r`` (binaries ``H_ir``, places ``u_ir`` in the region's own coordinates) is

    p_i = sum_r o_r H_ir + E_r u_ir,   A_r u_ir <= b_r H_ir,   sum_r H_ir = 1   (+ F_i where a hand may hang free)

so that the relaxation is the hull of the regions. Every stance has its own CoM ``c`` inside the limits of all its
contacts: ``l <= W^T (c - p_i) <= u`` in the heading frame ``W`` and 26 half-spaces inside the sphere. On level ground
these imply the limits of the validation, which hold in the contact frame; for tilted contacts and rails those are added
with big M. Consecutive feet satisfy the box and the ball of a step, which is shorter the higher it is, and a swing
rises by the highest stair at most, so that both feet step on each of high stairs. The objective is the sum of
horizontal deviations (L1, metres) from even steps on the straight line, plus ``FREE_COST`` for every hand placement
left out.
Deviations are counted per region, ``d_ir >= |n (o_r - t_i) H_ir + n E_r u_ir|``: in the relaxation, a mixture of two
regions costs as much as both, so that positions in the gap between them are not cheaper.
"""

import time
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import product
from typing import Final

import numpy as np
from scipy.optimize import Bounds, LinearConstraint, milp
from scipy.sparse import csr_array

from stridelab.contacts.effector_geometry import EffectorReach
from stridelab.contacts.planner.foothold_regions import Region
from stridelab.contacts.planner.obstacles import compatible_places
from stridelab.contacts.planner.schedule import CUT_SHARE, Node, Schedule, StartAndGoal, Transition
from stridelab.contacts.planner.step_limits import BALL_COVER, DIRECTIONS, RobotLimits, ball_rows, heading_frame
from stridelab.conventions import Rotation, Series, Vector3
from stridelab.dynamics.spatial import Placement

Columns = tuple[int, ...]
Terms = list[tuple[int, float]]
"""Pairs of column and coefficient; coefficients of the same column add up."""
INFEASIBLE: Final = 2
"""Status of ``scipy.optimize.milp`` for a program that is proven to have no solution."""
LIMIT_REACHED: Final = 1
"""Its status for a program that ended at its time limit."""
FULL_SHARE: Final = 0.8
"""Share of the processor time from which a solve counts as having used all of it."""
WALL_PER_CPU_MAX: Final = 10.0
"""Largest wall time of a planning relative to its processor time."""


class PlanningBudget:
    """Processor time of one planning, of all threads of the process, counted from the construction on.

    The result does not depend on what else the machine computes. Wall time is limited only as a safety, at
    ``WALL_PER_CPU_MAX`` times the processor time, for a process that hardly gets any.
    """

    def __init__(self, cpu_s: float) -> None:
        self.cpu_s, self._repeated_s = cpu_s, 0.0
        self._began_cpu_s, self._began_wall_s = time.process_time(), time.monotonic()

    @property
    def cpu_left_s(self) -> float:
        """Processor time left (s)."""
        return self.cpu_s + self._repeated_s - (time.process_time() - self._began_cpu_s)

    @property
    def wall_left_s(self) -> float:
        """Wall time left (s)."""
        return WALL_PER_CPU_MAX * self.cpu_s - (time.monotonic() - self._began_wall_s)

    @property
    def is_spent(self) -> bool:
        """Whether either is used up."""
        return self.cpu_left_s <= 0.0 or self.wall_left_s <= 0.0

    def exclude_attempt(self, used_s: float) -> None:
        """Do not count the processor time of an attempt that is repeated."""
        self._repeated_s += used_s


@dataclass(frozen=True, eq=False)
class MilpResult:
    """Solver result. ``x`` is None without a solution: infeasible if ``proven``, otherwise a timeout."""

    x: Series | None
    objective: float
    proven: bool


class LinearProgram:
    """``min c x`` subject to ``low <= A x <= high``, bounds and integrality, built row by row."""

    def __init__(self) -> None:
        self._low: list[float] = []
        self._high: list[float] = []
        self._cost: list[float] = []
        self._whole: list[int] = []
        self._entries: list[tuple[int, int, float]] = []
        self._row_low: list[float] = []
        self._row_high: list[float] = []

    def add_variables(
        self, n: int, low: float = -np.inf, high: float = np.inf, cost: float = 0.0, *, integer: bool = False
    ) -> Columns:
        """Add ``n`` variables; return their columns."""
        first = len(self._low)
        self._low += [low] * n
        self._high += [high] * n
        self._cost += [cost] * n
        self._whole += [int(integer)] * n
        return tuple(range(first, first + n))

    def add_row(self, terms: Terms, low: float = -np.inf, high: float = np.inf) -> None:
        """Add the constraint ``low <= sum of coefficient times variable <= high``."""
        row = len(self._row_low)
        self._entries += [(row, column, float(value)) for column, value in terms if value != 0.0]
        self._row_low.append(low)
        self._row_high.append(high)

    def solve(self, budget: PlanningBudget, least_s: float = 0.0) -> MilpResult:
        """Solve to HiGHS' gap of 1e-4, or return the best solution within the budget, of which ``least_s`` are left.

        HiGHS limits wall time only. An attempt that ended there without its share of the processor is repeated with
        as much wall time as the processor time of the budget takes.
        """
        shape = (len(self._row_low), len(self._low))
        rows, columns, values = zip(*self._entries, strict=True)
        A = csr_array((values, (rows, columns)), shape=shape)
        cpu_s = wall_s = max(budget.cpu_left_s, least_s)
        while True:
            began_s = time.process_time()
            solution = milp(
                np.array(self._cost),
                integrality=np.array(self._whole),
                bounds=Bounds(np.array(self._low), np.array(self._high)),
                constraints=LinearConstraint(A, np.array(self._row_low), np.array(self._row_high)),
                options={"time_limit": wall_s},
            )
            used_s, wall_left_s = time.process_time() - began_s, budget.wall_left_s
            if solution.status != LIMIT_REACHED or used_s >= FULL_SHARE * cpu_s or wall_left_s <= 0.0:
                break
            budget.exclude_attempt(used_s)
            wall_s = min(wall_left_s, wall_s * max(2.0, cpu_s / max(used_s, 1e-3)))
        if solution.x is None:
            return MilpResult(None, np.inf, solution.status == INFEASIBLE)
        return MilpResult(np.asarray(solution.x), float(solution.fun), proven=True)


FREE_COST: Final = 2.0
"""Cost (m) of leaving out the placement of a hand."""
FRAME_TOLERANCE: Final = 1e-9


@dataclass(frozen=True, eq=False)
class PlacedSchedule:
    """A solved schedule: placement (None: free) and region (None: not a variable) of every node, the objective."""

    placements: tuple[Placement | None, ...]
    regions: tuple[Region | None, ...]
    objective: float


@dataclass(frozen=True, eq=False)
class _NodeColumns:
    """Columns of a node: position ``p``, one binary per region, and the binary of a free effector."""

    p: Columns
    H: Columns
    F: int | None


class StepProgram:
    """The program of one schedule; with ``slack``, moves may violate their limits and only violations are minimised."""

    def __init__(self, plan: Schedule, limits: RobotLimits, ends: StartAndGoal, *, slack: bool = False) -> None:
        self.plan, self.limits, self.ends = plan, limits, ends
        self.program = LinearProgram()
        self.origin = np.mean([at.position_m for at in ends.start.values()], axis=0)
        corners = [r.corners_m for node in plan.nodes for r in node.choices]
        corners += [node.fixed.position_m[np.newaxis] for node in plan.nodes if node.fixed is not None]
        self.big_m = 2.0 * float(np.abs(np.concatenate(corners) - self.origin).max()) + 3.0
        self.slack = self.program.add_variables(len(plan.moves), 0.0, cost=1.0) if slack else None
        self.columns = [self._add_node(node) for node in plan.nodes]
        for move, stance in enumerate(plan.stances[1:]):
            self._add_stance([i for i in stance.values() if not plan.nodes[i].is_absent], move)
        for k in range(1, len(plan.feet)):
            self._constrain_step(plan.feet[k - 1], plan.feet[k], is_last=k == len(plan.feet) - 1)
        for k in range(2, len(plan.feet) + 1):
            self._constrain_swing(plan.walk[k - 2], plan.walk[k])
        if not slack:
            for k in range(2, len(plan.feet) + 1):
                for before in plan.walk[k - 2 : k]:
                    self._keep_clear(before, plan.walk[k])
            for standing, moving in zip(plan.feet, plan.feet[1:], strict=False):
                for cut in ends.forbidden:
                    self._avoid_transition(standing, moving, cut)

    def solve(self, budget: PlanningBudget, least_s: float = 0.0) -> MilpResult:
        """Solve the program within ``budget``, as ``LinearProgram.solve``."""
        return self.program.solve(budget, least_s)

    def placements_of(self, result: MilpResult) -> PlacedSchedule:
        """Extract the placements from a solution."""
        x = result.x
        if x is None:
            raise ValueError("the program has no solution")
        read = [self._read_node(node, spot, x) for node, spot in zip(self.plan.nodes, self.columns, strict=True)]
        return PlacedSchedule(tuple(at for at, _ in read), tuple(region for _, region in read), result.objective)

    def _read_node(self, node: Node, columns: _NodeColumns, x: Series) -> tuple[Placement | None, Region | None]:
        if node.fixed is not None or node.is_absent:
            return node.fixed, None
        if columns.F is not None and x[columns.F] > 0.5:
            return None, None
        region = node.choices[int(np.argmax(x[list(columns.H)]))]
        return Placement(x[list(columns.p)] + self.origin, region.rotation), region

    def _add_node(self, node: Node) -> _NodeColumns:
        program = self.program
        p = program.add_variables(3)
        if node.fixed is not None or node.is_absent:
            at = np.zeros(3) if node.fixed is None else node.fixed.position_m - self.origin
            for i in range(3):
                program.add_row([(p[i], 1.0)], at[i], at[i])
            return _NodeColumns(p, p[:0], None)
        H = program.add_variables(len(node.choices), 0.0, 1.0, integer=True)
        F = (
            int(program.add_variables(1, 0.0, 1.0, FREE_COST if self.slack is None else 0.0, integer=True)[0])
            if node.free
            else None
        )
        program.add_row([(h, 1.0) for h in H] + ([] if F is None else [(F, 1.0)]), 1.0, 1.0)
        place: list[Terms] = [[(p[i], 1.0)] for i in range(3)]
        for h, region in zip(H, node.choices, strict=True):
            u = program.add_variables(region.axes.shape[1])
            for row, b in zip(region.A, region.b, strict=True):
                program.add_row([*zip(u, row, strict=True), (h, -b)], high=0.0)
            if self.slack is None:
                self._add_deviation(node, region, h, u)
            for i in range(3):
                place[i] += [(h, self.origin[i] - region.origin_m[i]), *zip(u, -region.axes[i], strict=True)]
        for terms in place:
            program.add_row(terms, 0.0, 0.0)
        return _NodeColumns(p, H, F)

    def _add_stance(self, stance: list[int], move: int) -> None:
        nodes = [self.plan.nodes[i] for i in stance]
        if all(node.fixed is not None for node in nodes):
            return
        c = self.program.add_variables(3)
        for i, node in zip(stance, nodes, strict=True):
            spot, limits = self.columns[i], self.limits.effectors[node.effector]
            W = heading_frame(node.yaw_rad)
            away = [] if spot.F is None else [(spot.F, -self.big_m)]
            self._constrain_com(c, spot.p, W, limits.heading, away, 0.0, move)
            for R, members in self._tilted_frames(node, W):
                # M (1 - sum H): active only for the regions with this frame
                relaxed = [(spot.H[k], self.big_m) for k in members]
                self._constrain_com(c, spot.p, R, limits.contact, relaxed, self.big_m if relaxed else 0.0, move)

    def _tilted_frames(self, node: Node, W: Rotation) -> Iterable[tuple[Rotation, list[int]]]:
        """Contact frames that differ from the heading frame, each with the regions that have it."""
        if node.fixed is not None:
            return [] if np.abs(node.fixed.rotation - W).max() < FRAME_TOLERANCE else [(node.fixed.rotation, [])]
        groups: list[tuple[Rotation, list[int]]] = []
        for k, region in enumerate(node.choices):
            if np.abs(region.rotation - W).max() < FRAME_TOLERANCE:
                continue
            members = next((m for R, m in groups if np.abs(R - region.rotation).max() < FRAME_TOLERANCE), None)
            if members is None:
                groups.append((region.rotation, [k]))
            else:
                members.append(k)
        return groups

    def _constrain_com(
        self, c: Columns, p: Columns, R: Rotation, reach: EffectorReach, relaxed: Terms, big_m: float, move: int
    ) -> None:
        """Constrain ``c`` to the box and the sphere of a contact at ``p`` with axes ``R``, relaxed by big-M terms."""
        low, high = np.array(reach.com_low_m), np.array(reach.com_high_m)
        normals, radius = ball_rows(reach.com_distance_max_m, low, high)
        rows = [*zip(R.T, high, strict=True), *zip(-R.T, -low, strict=True)]
        rows += [(R @ n, radius) for n in normals]
        for n, offset in rows:
            terms = [*zip(c, n, strict=True), *zip(p, -n, strict=True), *relaxed, *self._slack_terms(move)]
            self.program.add_row(terms, high=offset + big_m)

    def _constrain_step(self, standing: int, moving: int, *, is_last: bool) -> None:
        """Constrain a step to its box and its ball."""
        nodes = self.plan.nodes
        fixed = nodes[standing].fixed is not None and nodes[moving].fixed is not None
        if fixed and is_last:
            return
        W = heading_frame(nodes[moving].yaw_rad)
        move = self._slack_terms(self.plan.moves.index(moving))
        apart = [(self.columns[moving].p, 1.0), (self.columns[standing].p, -1.0)]
        low, high = self.limits.offset_box_m(nodes[moving].effector, nodes[moving].yaw_rad - nodes[standing].yaw_rad)
        rows = [*zip(W.T, high, strict=True), *zip(-W.T, -low, strict=True)]
        reach = self.limits.feet_distance_max_m * BALL_COVER
        rows += [(n, reach) for n in DIRECTIONS]
        shorter = self.limits.length_per_rise(nodes[moving].effector)
        for ahead, up in product((1.0, -1.0), (1.0, -1.0)):
            rows.append((ahead * W[:, 0] + up * shorter * W[:, 2], float(high[0] if ahead > 0 else -low[0])))
        for n, offset in rows:
            self.program.add_row([t for p, sign in apart for t in zip(p, sign * n, strict=True)] + move, high=offset)

    def _constrain_swing(self, before: int, after: int) -> None:
        """Limit the height by which a foot rises or descends in one swing, and sideways its way in the plane."""
        ways = [(2, self.limits.defaults.rise_max_m)]
        if self.ends.aside_rad:
            ways += [(axis, 2.0 * self.limits.defaults.step_m) for axis in (0, 1)]
        move = self._slack_terms(self.plan.moves.index(after))
        for axis, most_m in ways:
            apart = [(self.columns[after].p[axis], 1.0), (self.columns[before].p[axis], -1.0)]
            self.program.add_row([*apart, *move], high=most_m)
            self.program.add_row([*apart, *[(column, -value) for column, value in move]], low=-most_m)

    def _keep_clear(self, before: int, after: int) -> None:
        """Exclude pairs of places of two feet with an obstacle between them."""
        first, second = self.plan.nodes[before], self.plan.nodes[after]
        passes = compatible_places(first.edges_outside, second.edges_outside)
        for row, free in enumerate(passes):
            chosen = [(self.columns[before].H[row], 1.0)] if first.fixed is None else []
            others = [(h, 1.0) for h, is_free in zip(self.columns[after].H, free, strict=False) if not is_free]
            if second.fixed is not None and not free[0] and not chosen:
                self.program.add_row([], low=1.0)  # both places are given: there is no solution
            elif not free.all():
                self.program.add_row([*chosen, *others], high=float(bool(chosen) and bool(others)))

    def _avoid_transition(self, standing: int, moving: int, cut: Transition) -> None:
        """Let a step go less far than a forbidden transition, in its direction from a neutral stance."""
        nodes, feet = self.plan.nodes, self.limits.feet
        is_given = nodes[standing].fixed is not None and nodes[moving].fixed is not None
        if nodes[moving].effector != cut.foot or is_given:
            return
        side = 1.0 if cut.foot == feet[0] else -1.0
        neutral = np.array([0.0, side * self.limits.defaults.width_m])
        away = np.array(cut.offset_m) - neutral
        n = heading_frame(nodes[moving].yaw_rad)[:, :2] @ away
        apart = [(self.columns[moving].p, 1.0), (self.columns[standing].p, -1.0)]
        terms = [t for p, sign in apart for t in zip(p, sign * n, strict=True)]
        self.program.add_row(terms, high=float(away @ neutral + CUT_SHARE * away @ away))

    def _add_deviation(self, node: Node, region: Region, h: int, u: Columns) -> None:
        """Add the deviation of a position in ``region`` from even steps; hands count along the path only."""
        W = heading_frame(node.yaw_rad)
        apart = region.origin_m - self.target_m(node)
        for n in W.T[: 2 if node.effector in self.limits.feet else 1]:
            (d,) = self.program.add_variables(1, 0.0, cost=1.0)
            at = [(h, float(n @ apart)), *zip(u, n @ region.axes, strict=True)]
            self.program.add_row([*at, (d, -1.0)], high=0.0)
            self.program.add_row([*at, (d, 1.0)], low=0.0)

    def target_m(self, node: Node) -> Vector3:
        """Target of an effector for even steps: feet beside the straight line, hands ahead of them as at the start."""
        feet, ends = self.limits.feet, self.ends
        start, goal = (np.mean([end[foot].position_m for foot in feet], axis=0) for end in (ends.start, ends.goal))
        steps = len(self.plan.feet) - 1
        middle = start + min(1.0, node.step / max(1, steps - 1)) * (goal - start)
        W = heading_frame(node.yaw_rad)
        if node.effector in feet:
            side = 1.0 if node.effector == feet[0] else -1.0
            return np.asarray(middle + side * self.limits.defaults.width_m / 2 * W[:, 1])
        reference_stance, origin = (ends.start, start) if node.effector in ends.start else (ends.goal, goal)
        return np.asarray(middle + reference_stance[node.effector].position_m - origin)

    def _slack_terms(self, move: int) -> Terms:
        return [] if self.slack is None else [(self.slack[move], -1.0)]
