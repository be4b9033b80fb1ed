"""Obstacles that a robot walks around: boxes and rails too high to step over and not high enough to pass below.

An obstacle is the outline of a box or rail in the horizontal plane, a convex polygon ``{x : n_i x <= b_i}``. Feet keep
outside of it, grown by a rectangle in the heading frame: the extent of the body where the obstacle is as high as the
hands, else that of the sole. Two places outside of the same edge ``i`` have a straight line between them that does not
meet the obstacle. The planner therefore allows a step, and the swing of one foot between its two places, only between
places that share an edge for every obstacle that is in the way of both.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial import ConvexHull

from stridelab.contacts.planner.step_limits import EffectorLimits, RobotLimits, StepDefaults, heading_frame
from stridelab.contacts.swing import STEP_OVER_M
from stridelab.contacts.terrain import Box, Surface, bounding_box
from stridelab.conventions import Vector3
from stridelab.dynamics.spatial import Placement

HAND_HEIGHT_SHARE: Final = 0.25
"""Height of an obstacle over that of the robot from which the whole body keeps away from it, not only the sole."""
CORNER_SIGNS: Final = np.array(np.meshgrid(*[(-0.5, 0.5)] * 3)).reshape(3, -1).T

OutsideEdges = Mapping[str, frozenset[int]]
"""For every obstacle in the way at a place, by name, the edges outside of which the place is."""


@dataclass(frozen=True, eq=False)
class Obstacle:
    """A box or a rail: outline ``normals x <= offsets_m`` in the horizontal plane, lowest and highest ``z_m``."""

    name: str
    normals: Float[np.ndarray, "m 2"]
    offsets_m: Float[np.ndarray, "m"]
    z_m: tuple[float, float]
    robot: StepDefaults
    is_rail: bool = False

    @staticmethod
    def of_surface(surface: Surface, robot: StepDefaults) -> "Obstacle":
        """The obstacle that a surface is."""
        box = surface if isinstance(surface, Box) else bounding_box(surface)
        corners = box.placement.act(CORNER_SIGNS * box.size_m)
        edges = np.unique(np.round(ConvexHull(corners[:, :2]).equations, 9), axis=0)
        heights = float(corners[:, 2].min()), float(corners[:, 2].max())
        return Obstacle(surface.name, edges[:, :2], -edges[:, 2], heights, robot, not isinstance(surface, Box))

    def is_in_way(self, low_m: float, high_m: float) -> bool:
        """Whether a robot on a place with heights from ``low_m`` to ``high_m`` can neither step over nor pass below."""
        return self.z_m[1] > low_m + STEP_OVER_M and self.z_m[0] < high_m + self.robot.body_height_m

    def grown_offsets_m(self, ground_m: float, shape: EffectorLimits, yaw_rad: float) -> Float[np.ndarray, "m"]:
        """Offsets of the edges beyond which a foot at height ``ground_m`` stands with room for the robot.

        In single support the trunk is above that foot: half the body's width counts from the sole's middle.
        """
        half = np.array(shape.half_size_m)
        if not self.is_rail and self.z_m[1] > ground_m + HAND_HEIGHT_SHARE * self.robot.body_height_m:
            ahead_m, aside_m = self.robot.body_half_size_m
            half = np.maximum(half, (ahead_m, aside_m + self.robot.width_m / 2))
        return self._offsets_of_grown_box(half, yaw_rad)

    def edges_outside(self, position_m: Vector3, shape: EffectorLimits, yaw_rad: float) -> frozenset[int]:
        """Edges outside of which a sole at ``position_m`` is."""
        offsets = self._offsets_of_grown_box(np.array(shape.half_size_m), yaw_rad)
        return frozenset(np.flatnonzero(self.normals @ position_m[:2] >= offsets - 1e-9).tolist())

    def meets_segment(self, start_m: Vector3, end_m: Vector3, offsets_m: Float[np.ndarray, "m"]) -> bool:
        """Whether the line between two points enters the polygon with these offsets."""
        first, last = 0.0, 1.0
        for a, b in zip(self.normals @ start_m[:2] - offsets_m, self.normals @ end_m[:2] - offsets_m, strict=True):
            if a >= 0.0 and b >= 0.0:
                return False
            if a > 0.0:
                first = max(first, a / (a - b))
            elif b > 0.0:
                last = min(last, a / (a - b))
        return bool(first < last - 1e-9)

    def _offsets_of_grown_box(self, half_m: Float[np.ndarray, "2"], yaw_rad: float) -> Float[np.ndarray, "m"]:
        axes = heading_frame(yaw_rad)[:2, :2]
        return np.asarray(self.offsets_m + np.abs(self.normals @ axes) @ half_m)


def placement_edges(
    obstacles: Iterable[Obstacle], at: Placement, shape: EffectorLimits, yaw_rad: float
) -> OutsideEdges:
    """Edges outside of which a given placement of a sole is, for the obstacles in its way."""
    z = float(at.position_m[2])
    return {
        obstacle.name: obstacle.edges_outside(at.position_m, shape, yaw_rad)
        for obstacle in obstacles
        if obstacle.is_in_way(z, z)
    }


def compatible_places(first: list[OutsideEdges], second: list[OutsideEdges]) -> Bool[np.ndarray, "n m"]:
    """Whether the lines between places ``i`` and ``j`` meet no obstacle."""
    return np.array([[not blocking_obstacles(a, b) for b in second] for a in first], dtype=bool).reshape(
        len(first), len(second)
    )


def blocking_obstacles(first: OutsideEdges, second: OutsideEdges) -> list[str]:
    """Names of the obstacles between two places."""
    return [name for name in first.keys() & second.keys() if not first[name] & second[name]]


def obstacles_met(
    surfaces: Iterable[Surface], feet: list[tuple[str, Placement]], yaws_rad: list[float], limits: RobotLimits
) -> Iterator[Obstacle]:
    """Obstacles in the way of a walk: foot placements in turn, from both of the start on (``Schedule.walk``)."""
    lines = [(i, k) for k in range(2, len(feet)) for i in (k - 1, k - 2)]
    for surface in surfaces:
        obstacle = Obstacle.of_surface(surface, limits.defaults)
        for i, k in lines:
            start, end = feet[i][1].position_m, feet[k][1].position_m
            low, high = sorted((float(start[2]), float(end[2])))
            if not obstacle.is_in_way(high, low):
                continue
            offsets = obstacle.grown_offsets_m(high, limits.effectors[feet[k][0]], yaws_rad[k])
            if obstacle.meets_segment(start, end, offsets):
                yield obstacle
                break
