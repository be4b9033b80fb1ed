"""Contact surfaces: boxes, which feet stand on, and rails.

Geometry of contact surfaces: faces of boxes (a sole stands on the upper one) and the top line of rails.

A face is a rectangle with a frame (x and y along its edges, z outwards); a contact on it at local coordinates
``(x, y, z)`` is ``z`` above it and ``min(a - |x|, b - |y|)`` away from its edge. A rail with direction ``d`` has the
normal ``n = (z - (z d) d) / |..|``, perpendicular to it in its vertical plane; contacts lie on the line
``axis + radius n``.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float

from stridelab.conventions import Points, Rotation, Series, Vector3
from stridelab.dynamics.spatial import Placement


@dataclass(frozen=True, eq=False)
class Box:
    """A box; ``placement`` is that of its centre, ``size_m`` its three edges. ``friction`` None: the scenario's."""

    name: str
    placement: Placement
    size_m: Vector3
    friction: float | None = None


@dataclass(frozen=True, eq=False)
class Rail:
    """A round bar from one end of its axis to the other."""

    name: str
    from_m: Vector3
    to_m: Vector3
    radius_m: float
    friction: float | None = None


Surface = Box | Rail


@dataclass(frozen=True, eq=False)
class Terrain:
    """All surfaces; the floor is a box as well."""

    surfaces: tuple[Surface, ...]

    @staticmethod
    def from_surfaces(surfaces: Sequence[Surface]) -> "Terrain":
        """Create a terrain from any sequence of surfaces."""
        return Terrain(tuple(surfaces))

    @property
    def boxes(self) -> tuple[Box, ...]:
        """The boxes among the surfaces."""
        return tuple(surface for surface in self.surfaces if isinstance(surface, Box))

    @cached_property
    def box_bounds_m(self) -> tuple[Points, Points]:
        """Lower and upper corners ``(n_boxes, 3)`` of the axis-aligned bounding box of every box."""
        center = np.array([box.placement.position_m for box in self.boxes]).reshape(-1, 3)
        half = np.array([np.abs(box.placement.rotation) @ box.size_m / 2 for box in self.boxes]).reshape(-1, 3)
        return center - half, center + half

    @property
    def rails(self) -> tuple[Rail, ...]:
        """The rails among the surfaces."""
        return tuple(surface for surface in self.surfaces if isinstance(surface, Rail))


UP = np.array([0.0, 0.0, 1.0])
UP.flags.writeable = False
PARALLEL_COSINE = 1e-9
"""Cosine below which a line counts as parallel to a face."""


@dataclass(frozen=True, eq=False)
class SurfacePosition:
    """Position of points ``(n,)`` relative to one surface.

    ``height_m`` is the distance along the normal, negative inside. ``edge_m`` is the distance to the edge of the
    contact area, negative outside; ``aside_m`` is the lateral distance to that area, 0 right above or below it.
    """

    height_m: Series
    edge_m: Series
    aside_m: Series

    @property
    def distance_m(self) -> Series:
        """Distance to the contact area."""
        return np.asarray(np.hypot(self.height_m, self.aside_m))


@dataclass(frozen=True, eq=False)
class ContactArea:
    """The contact area of a surface: a rectangle, of zero width for a rail.

    ``frame`` holds the directions of its edges and its normal as columns, ``half_m`` half its edges.
    """

    surface: Surface
    center_m: Vector3
    frame: Rotation
    half_m: Float[np.ndarray, "2"]

    @property
    def normal(self) -> Vector3:
        """Outward unit normal."""
        return self.frame[:, 2]

    def locate(self, points_m: Points) -> SurfacePosition:
        """Position of ``points_m`` ``(n, 3)`` relative to this area."""
        local = (points_m - self.center_m) @ self.frame
        inside = self.half_m - np.abs(local[:, :2])
        edge = inside[:, 0] if isinstance(self.surface, Rail) else inside.min(axis=1)
        return SurfacePosition(local[:, 2], edge, np.hypot(*np.maximum(-inside, 0.0).T))


def contact_area(surface: Surface) -> ContactArea:
    """The most upward face of a box, or the top line of a rail.

    A vertical rail has no upper side; its normal is taken along x.
    """
    return face_towards(surface, UP) if isinstance(surface, Box) else _top_line(surface)


def face_towards(box: Box, direction: Vector3) -> ContactArea:
    """The face of a box whose outward normal is nearest to ``direction`` (world frame)."""
    R = box.placement.rotation
    along = direction @ R
    axis = int(np.argmax(np.abs(along)))
    sign = 1.0 if along[axis] > 0 else -1.0
    x, y = ((1, 2), (2, 0), (0, 1))[axis]
    frame = np.column_stack([R[:, x], sign * R[:, y], sign * R[:, axis]])
    center = box.placement.position_m + box.size_m[axis] / 2 * frame[:, 2]
    return ContactArea(box, center, frame, box.size_m[[x, y]] / 2)


def bounding_box(rail: Rail) -> Box:
    """The smallest box around a rail, with its x axis along it."""
    span = rail.to_m - rail.from_m
    length = float(np.linalg.norm(span))
    d = span / length
    across = np.cross(d, UP if abs(d[2]) < 0.9 else [1.0, 0.0, 0.0])
    across = across / np.linalg.norm(across)
    R = np.column_stack([d, across, np.cross(d, across)])
    size_m = np.array([length, 2.0 * rail.radius_m, 2.0 * rail.radius_m])
    return Box(rail.name, Placement((rail.from_m + rail.to_m) / 2, R), size_m, rail.friction)


def is_vertical(rail: Rail) -> bool:
    """Whether the rail has no upper side (within a degree)."""
    d = rail.to_m - rail.from_m
    return bool(abs(d[2]) > np.cos(np.radians(1.0)) * np.linalg.norm(d))


def depth_in_box_m(box: Box, points_m: Points) -> Series:
    """Depth of points ``(n, 3)`` inside a box: distance to its nearest face, negative outside."""
    local = (points_m - box.placement.position_m) @ box.placement.rotation
    return np.asarray((box.size_m / 2 - np.abs(local)).min(axis=1))


def vertical_span_m(box: Box, points_m: Points) -> tuple[Series, Series]:
    """Heights where the vertical lines through points ``(n, 3)`` enter and leave a box; NaN if they miss it."""
    R, half = box.placement.rotation, box.size_m / 2
    local, d = (points_m - box.placement.position_m) @ R, UP @ R
    across = np.abs(d) > PARALLEL_COSINE
    first = (-half[across] * np.sign(d[across]) - local[:, across]) / d[across]
    last = (half[across] * np.sign(d[across]) - local[:, across]) / d[across]
    low, high = first.max(axis=1), last.min(axis=1)
    hit = (low <= high) & (np.abs(local[:, ~across]) <= half[~across]).all(axis=1)
    z = points_m[:, 2]
    return np.where(hit, z + low, np.nan), np.where(hit, z + high, np.nan)


def _top_line(rail: Rail) -> ContactArea:
    span = rail.to_m - rail.from_m
    length = float(np.linalg.norm(span))
    d = span / length
    n = np.array([1.0, 0.0, 0.0]) if is_vertical(rail) else UP
    n = n - (n @ d) * d
    n = n / np.linalg.norm(n)
    center = (rail.from_m + rail.to_m) / 2 + rail.radius_m * n
    return ContactArea(rail, center, np.column_stack([d, np.cross(n, d), n]), np.array([length / 2, 0.0]))
