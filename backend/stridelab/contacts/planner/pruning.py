"""Removes unreachable regions from a schedule before the mixed-integer program is solved.

Along the chain of foot moves the positions of foot ``k`` lie in the positions of foot ``k - 1`` plus the box of the
steps. Boxes are propagated from the start forwards and from the goal backwards, region by region, in the heading frame
of the start. They are outer bounds, so no plan is lost. A region whose two boxes do not intersect is removed.
"""

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import product
from typing import Final

import numpy as np
from jaxtyping import Bool, Float

from stridelab.contacts.planner.foothold_regions import Region
from stridelab.contacts.planner.obstacles import OutsideEdges, blocking_obstacles, compatible_places
from stridelab.contacts.planner.schedule import Node, RegionLookup, Schedule, StartAndGoal
from stridelab.contacts.planner.step_limits import RobotLimits, heading_frame
from stridelab.conventions import Vector3
from stridelab.dynamics.spatial import Placement

TOLERANCE_M: Final = 1e-6

Boxes = Float[np.ndarray, "_ 2 3"]
"""Lower and upper corner per region; an empty box has its lower corner above the upper one."""


def prune_schedule(plan: Schedule, limits: RobotLimits) -> Schedule | None:
    """The schedule with only the regions on a path from start to goal; None if a foot has none."""
    frame = heading_frame(plan.nodes[0].yaw_rad)
    nodes = [plan.nodes[i] for i in plan.feet]
    full = [_node_boxes(node, frame) for node in nodes]
    steps = [_step_box(node, limits, frame) for node in nodes]
    outside = [node.edges_outside for node in nodes]
    passes = [compatible_places(outside[max(0, k - 1)], outside[k]) for k in range(len(nodes))]
    forward = [full[0]]
    for k in range(1, len(nodes)):
        forward.append(_reachable_boxes(full[k], forward[-1], *steps[k], passes[k].T, given=_both_feet_given(nodes, k)))
    backward = [full[-1]]
    for k in range(len(nodes) - 1, 0, -1):
        low, high = steps[k]
        given = _both_feet_given(nodes, k)
        backward.insert(0, _reachable_boxes(full[k - 1], backward[0], -high, -low, passes[k], given=given))
    changed = list(plan.nodes)
    for k, node in enumerate(nodes):
        low = np.maximum(forward[k][:, 0], backward[k][:, 0])
        high = np.minimum(forward[k][:, 1], backward[k][:, 1])
        open_ = (low <= high + TOLERANCE_M).all(axis=1)
        if not open_.any():
            return None
        if node.fixed is None:
            reachable = tuple(region for region, on in zip(node.choices, open_, strict=True) if on)
            changed[plan.feet[k]] = replace(node, choices=reachable)
    return plan.with_nodes(tuple(changed))


def fewest_moves(ends: StartAndGoal, limits: RobotLimits, regions_at: RegionLookup) -> int:
    """A lower bound of the number of foot moves to the goal; 0 if the search finds none.

    Breadth-first search over the pair of regions in which the feet stand. A move must satisfy the box of a step and the
    height of a swing somewhere in the regions; positions inside the regions do not restrict the next move.
    """
    frame, yaw = heading_frame(ends.yaw_rad), ends.middle_yaw_rad
    boxes, goals, reach = {}, {}, {}
    for foot in limits.feet:
        nodes = [Node(foot, 0, yaw, None, regions_at(foot, yaw))]
        nodes += [ends.fixed_node(foot, 0, yaw, end[foot], limits) for end in (ends.goal, ends.start)]
        boxes[foot] = np.concatenate([_node_boxes(node, frame) for node in nodes])
        goals[foot] = len(boxes[foot]) - 2
        reach[foot] = _step_box(Node(foot, 0, yaw), limits, frame)
    left, right = limits.feet
    step, swing = {}, {}
    for foot, other in ((left, right), (right, left)):
        at = boxes[foot]
        step[foot] = _boxes_meet(at[np.newaxis], boxes[other][:, np.newaxis] + np.stack(reach[foot]))
        up = np.array([[-np.inf, -np.inf, -limits.defaults.rise_max_m], [np.inf, np.inf, limits.defaults.rise_max_m]])
        swing[foot] = _boxes_meet(at[np.newaxis], at[:, np.newaxis] + up)
    start = (len(boxes[left]) - 1, len(boxes[right]) - 1)
    counts = {(*start, foot): 0 for foot in limits.feet}
    queue = deque(counts)
    while queue:
        at_left, at_right, moving = state = queue.popleft()
        if (at_left, at_right) == (goals[left], goals[right]):
            return counts[state]
        before, still = (at_left, at_right) if moving == left else (at_right, at_left)
        for to in np.flatnonzero(step[moving][still] & swing[moving][before]).tolist():
            after = (to, at_right, right) if moving == left else (at_left, to, left)
            if after not in counts:
                counts[after] = counts[state] + 1
                queue.append(after)
    return 0


def _boxes_meet(one: Float[np.ndarray, "... 2 3"], other: Float[np.ndarray, "... 2 3"]) -> Bool[np.ndarray, "..."]:
    low, high = np.maximum(one[..., 0, :], other[..., 0, :]), np.minimum(one[..., 1, :], other[..., 1, :])
    return np.asarray((low <= high + TOLERANCE_M).all(axis=-1))


@dataclass(frozen=True)
class Gap:
    """The gap between a surface reached after ``step`` foot moves and the nearest unreached one.

    ``missing_m`` is the signed distance (forward, left, up) that a step lacks, in the heading frame of the start.
    ``obstacles`` are between the two places.
    """

    step: int
    foot: str
    from_surface: str
    to_surface: str
    missing_m: tuple[float, float, float]
    obstacles: tuple[str, ...] = ()


def first_gap(
    ends: StartAndGoal, limits: RobotLimits, regions_at: RegionLookup, names: Mapping[str, tuple[str, str]]
) -> Gap | None:
    """The narrowest gap that no number of steps crosses; None if the goal is reachable.

    ``names`` are the surfaces of start and goal by foot. Obstacles leave different room at the headings of start,
    middle and goal: a place at any of them counts.
    """
    frame = heading_frame(ends.yaw_rad)
    yaw = ends.middle_yaw_rad
    places: list[tuple[str, str, Boxes, OutsideEdges]] = []
    for foot, at_rad in product(limits.feet, ends.passing_yaws_rad):
        node = Node(foot, 0, at_rad, None, regions_at(foot, at_rad))
        boxes = zip(node.choices, _node_boxes(node, frame), strict=True)
        places += [(foot, region.surface, box[np.newaxis], region.outside) for region, box in boxes]
    starts = [_end_place(ends, foot, names[foot][0], ends.start[foot], limits, frame) for foot in limits.feet]
    places += [_end_place(ends, foot, names[foot][1], ends.goal[foot], limits, frame) for foot in limits.feet]
    steps = {foot: _step_box(Node(foot, 0, yaw), limits, frame) for foot in limits.feet}
    level: dict[int, int] = {}
    queue = deque((0, *start) for start in starts)
    reached: list[tuple[int, str, str, Boxes, OutsideEdges]] = []
    while queue:
        n, foot, surface, box, outside = queue.popleft()
        reached.append((n, foot, surface, box, outside))
        for i, (other, name, target, beyond) in enumerate(places):
            if i in level or other == foot or blocking_obstacles(outside, beyond):
                continue
            if not _missing_step(box, target, *steps[other]).any():
                level[i] = n + 1
                queue.append((n + 1, other, name, target, beyond))
    if level.keys() & {len(places) - 1, len(places) - 2}:
        return None
    lacking = [
        (float(np.linalg.norm(missing)), n, other, surface, name, missing, blocking_obstacles(outside, beyond))
        for n, foot, surface, box, outside in reached
        for i, (other, name, target, beyond) in enumerate(places)
        if i not in level and other != foot
        for missing in [_missing_step(box, target, *steps[other])]
    ]
    _, n, foot, surface, name, missing, between = min(lacking, key=lambda gap: gap[:2])
    x, y, z = missing.tolist()
    return Gap(n, foot, surface, name, (x, y, z), tuple(between))


def _end_place(
    ends: StartAndGoal, foot: str, surface: str, at: Placement, limits: RobotLimits, frame: Float[np.ndarray, "3 3"]
) -> tuple[str, str, Boxes, OutsideEdges]:
    node = ends.fixed_node(foot, 0, ends.middle_yaw_rad, at, limits)
    return foot, surface, _node_boxes(node, frame), node.outside


def _missing_step(box: Boxes, target: Boxes, low: Vector3, high: Vector3) -> Vector3:
    """Signed distance of ``target`` from ``box`` plus a step, per axis; 0 if they intersect."""
    beyond = np.maximum(target[0, 0] - box[0, 1] - high, 0.0)
    before = np.maximum(box[0, 0] + low - target[0, 1], 0.0)
    missing = beyond - before
    return np.asarray(np.where(np.abs(missing) > TOLERANCE_M, missing, 0.0))


def _both_feet_given(nodes: list[Node], k: int) -> bool:
    """Whether both feet are fixed by the goal, whose stance may be wider than a step."""
    return k == len(nodes) - 1 and nodes[k].fixed is not None and nodes[k - 1].fixed is not None


def _reachable_boxes(
    full: Boxes, previous: Boxes, low: Vector3, high: Vector3, passes: Bool[np.ndarray, "n m"], *, given: bool
) -> Boxes:
    """Per region, the bounding box of its intersections with all previous boxes, each plus a step.

    ``passes`` tells whether no obstacle is between a region and a previous one.
    """
    if given:
        return full
    lowest = np.maximum(full[:, np.newaxis, 0], previous[np.newaxis, :, 0] + low)
    highest = np.minimum(full[:, np.newaxis, 1], previous[np.newaxis, :, 1] + high)
    met = ((lowest <= highest + TOLERANCE_M).all(axis=2) & passes)[..., np.newaxis]
    return np.stack([np.where(met, lowest, np.inf).min(axis=1), np.where(met, highest, -np.inf).max(axis=1)], axis=1)


def _node_boxes(node: Node, frame: Float[np.ndarray, "3 3"]) -> Boxes:
    if node.fixed is not None:
        return np.tile(node.fixed.position_m @ frame, (1, 2, 1))
    return np.array([_region_box(region, frame) for region in node.choices]).reshape(-1, 2, 3)


def _region_box(region: Region, frame: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "2 3"]:
    local = region.corners_m @ frame
    return np.stack([local.min(axis=0), local.max(axis=0)])


def _step_box(node: Node, limits: RobotLimits, frame: Float[np.ndarray, "3 3"]) -> tuple[Vector3, Vector3]:
    """The box of the steps of a foot, rotated from its heading frame into that of the start."""
    low, high = limits.offset_box_m(node.effector)
    turn = frame.T @ heading_frame(node.yaw_rad)
    middle, half = turn @ (low + high) / 2, np.abs(turn) @ (high - low) / 2
    return middle - half, middle + half
