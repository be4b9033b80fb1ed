"""Step schedules: the order in which the effectors move, and the candidate regions of every move.

``N`` foot moves swing the feet in turn; the last two land on the goal. A hand that start or goal names moves before
every second foot move and once at the end; in between it may be free. The heading changes evenly from start to goal, or
on a detour turns aside first and back at the end, so that the robot passes sideways in between.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from stridelab.contacts.planner.foothold_regions import Region
from stridelab.contacts.planner.obstacles import Obstacle, OutsideEdges, placement_edges
from stridelab.contacts.planner.step_limits import RobotLimits
from stridelab.dynamics.spatial import Placement

SAME_M: Final = 1e-4
"""Placements that differ by less are equal (m, and entries of rotations)."""

TURN_MAX_RAD: Final = math.radians(12.0)
"""Largest heading change of a step."""

CUT_SHARE: Final = 0.75
"""Share of a forbidden transition's distance from a neutral stance up to which steps may go in its direction."""

Stance = Mapping[str, Placement]


@dataclass(frozen=True, eq=False)
class Node:
    """One placement of an effector: ``fixed``, selected from ``choices``, or absent.

    ``free`` allows the effector to have no contact. ``step`` counts the foot moves up to here. ``outside`` are the
    edges of obstacles outside of which a ``fixed`` placement is.
    """

    effector: str
    step: int
    yaw_rad: float
    fixed: Placement | None = None
    choices: tuple[Region, ...] = ()
    free: bool = False
    outside: OutsideEdges = field(default_factory=dict)

    @property
    def is_absent(self) -> bool:
        """Whether the effector has no contact in any solution."""
        return self.fixed is None and not self.choices

    @property
    def edges_outside(self) -> list[OutsideEdges]:
        """Edges of obstacles outside of which each place is: the fixed one, or every choice."""
        return [self.outside] if self.fixed is not None else [region.outside for region in self.choices]


@dataclass(frozen=True, eq=False)
class Schedule:
    """Nodes, and the node of every move; ``stances`` are the nodes by effector at the start and after every move."""

    nodes: tuple[Node, ...]
    moves: tuple[int, ...]
    stances: tuple[Mapping[str, int], ...]
    feet: tuple[int, ...]

    @property
    def walk(self) -> tuple[int, ...]:
        """Nodes of the feet in turn, from both feet of the start on: a foot swings from the node before the last."""
        starts = [i for i in self.stances[0].values() if i != self.feet[0]]
        first = next(i for i in starts if self.nodes[i].effector == self.nodes[self.feet[1]].effector)
        return (first, *self.feet)

    def with_nodes(self, nodes: tuple[Node, ...]) -> "Schedule":
        """The same moves with other nodes."""
        return replace(self, nodes=nodes)


@dataclass(frozen=True, eq=False)
class Transition:
    """A step of ``foot`` to ``offset_m``, ahead of and to the left of the other foot (heading frame)."""

    foot: str
    offset_m: tuple[float, float]


@dataclass(frozen=True, eq=False)
class StartAndGoal:
    """Start and goal with their headings; the robot turns by ``turn_rad`` in between, around the ``obstacles``.

    In the middle of the walk the heading is ``aside_rad`` further, so that the robot passes sideways. No step goes as
    far in its direction as a ``forbidden`` transition of the same foot.
    """

    start: Stance
    goal: Stance
    yaw_rad: float
    turn_rad: float
    obstacles: tuple[Obstacle, ...] = ()
    forbidden: tuple[Transition, ...] = ()
    aside_rad: float = 0.0

    @property
    def middle_yaw_rad(self) -> float:
        """Heading halfway."""
        return self.yaw_rad + self.turn_rad / 2 + self.aside_rad

    @property
    def passing_yaws_rad(self) -> list[float]:
        """Headings at which obstacles can be passed: halfway, and around obstacles those of start and goal, too."""
        ends = (self.yaw_rad, self.yaw_rad + self.turn_rad) if self.obstacles else ()
        return list(dict.fromkeys((self.middle_yaw_rad, *ends)))

    @property
    def aside_steps(self) -> int:
        """Steps in which the heading turns aside, and in which it turns back."""
        return math.ceil(abs(self.aside_rad) / TURN_MAX_RAD)

    def yaw_after(self, step: int, steps: int) -> float:
        """Heading (rad) of the foot of ``step``, of ``steps`` in all."""
        turned = min(1.0, step / self.aside_steps, (steps - step) / self.aside_steps) if self.aside_steps else 0.0
        return self.yaw_rad + self.turn_rad * min(1.0, step / max(1, steps - 1)) + self.aside_rad * turned

    @staticmethod
    def from_stances(start: Stance, goal: Stance, feet: tuple[str, str]) -> "StartAndGoal":
        """Create from two stances; headings are the mean yaw of the soles."""
        yaw, end = (_mean_yaw(stance, feet) for stance in (start, goal))
        return StartAndGoal(start, goal, yaw, float(np.angle(np.exp(1j * (end - yaw)))))

    def fixed_node(
        self, effector: str, step: int, yaw_rad: float, fixed: Placement | None, limits: RobotLimits
    ) -> Node:
        """Node of a given placement, or of none."""
        shape = limits.effectors[effector]
        outside: OutsideEdges = {}
        if fixed is not None and shape.kind == "surface":
            outside = placement_edges(self.obstacles, fixed, shape, yaw_rad)
        return Node(effector, step, yaw_rad, fixed, outside=outside)


RegionLookup = Callable[[str, float], tuple[Region, ...]]
"""Lookup of the regions of an effector at a heading (rad)."""


def build_schedule(
    ends: StartAndGoal, limits: RobotLimits, regions_at: RegionLookup, steps: int, first: str
) -> Schedule | None:
    """A schedule of ``steps`` foot moves beginning with ``first``; None if it cannot end at the goal."""
    order = [first, *(foot for foot in limits.feet if foot != first)]
    still = [order[k % 2] for k in range(steps, 2)]
    if any(_differ(ends.start[foot], ends.goal[foot]) for foot in still):
        return None
    hands = sorted(name for name in {*ends.start, *ends.goal} if limits.effectors[name].kind == "point")
    nodes: list[Node] = []
    standing: dict[str, int] = {}
    for name in (*limits.feet, *hands):
        standing[name] = len(nodes)
        nodes.append(ends.fixed_node(name, 0, ends.yaw_rad, ends.start.get(name), limits))
    feet, moves, stances = [standing[order[1]]], [], [dict(standing)]

    def append_move(node: Node) -> None:
        standing[node.effector] = len(nodes)
        moves.append(len(nodes))
        nodes.append(node)
        stances.append(dict(standing))

    for k in range(1, steps + 1):
        yaw = ends.yaw_after(k, steps)
        if k % 2:
            for hand in hands:
                append_move(Node(hand, k - 1, yaw, None, regions_at(hand, yaw), True))
        foot = order[(k - 1) % 2]
        fixed = ends.goal[foot] if k > steps - 2 else None
        node = Node(foot, k, yaw, None, regions_at(foot, yaw))
        append_move(node if fixed is None else ends.fixed_node(foot, k, yaw, fixed, limits))
        feet.append(standing[foot])
    for hand in hands:
        append_move(Node(hand, steps, ends.yaw_rad + ends.turn_rad, ends.goal.get(hand)))
    return Schedule(tuple(nodes), tuple(moves), tuple(stances), tuple(feet))


def _differ(one: Placement, other: Placement) -> bool:
    return bool(
        np.linalg.norm(one.position_m - other.position_m) > SAME_M
        or np.abs(one.rotation - other.rotation).max() > SAME_M
    )


def _mean_yaw(stance: Stance, feet: tuple[str, str]) -> float:
    x, y = np.sum([stance[foot].rotation[:2, 0] for foot in feet], axis=0)
    return float(np.arctan2(y, x))
