"""Convex foothold regions: the configuration space of the centre of a sole on every face.

A face is shrunk by the sole, turned to the heading; boxes that rise above it are grown by the sole (Minkowski sum)
and subtracted. The part of a convex piece ``P`` outside a convex obstacle ``{n_k x <= b_k}`` is the union of
``P and {n_k x >= b_k}`` over its edges, so that the pieces stay convex and may overlap. Finally every piece is shrunk
by a margin, at most 0.9 times its inradius. The region of a rail is a segment.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from jaxtyping import Float
from scipy.optimize import linprog
from scipy.spatial import ConvexHull, QhullError

from stridelab.contacts.planner.obstacles import Obstacle, OutsideEdges
from stridelab.contacts.planner.step_limits import EffectorLimits
from stridelab.contacts.terrain import Box, ContactArea, Rail, Terrain, contact_area, is_vertical
from stridelab.conventions import Points, Rotation, Vector3

BLOCKING_LAYER_M: Final = (0.010, 0.10)
"""Heights above a face between which a box blocks a sole."""
MIN_AREA_M2: Final = 1e-9
INRADIUS_SHARE: Final = 0.9
"""Largest margin of a piece relative to its inradius."""
PIECES_MAX: Final = 60
"""Maximum number of pieces of one face; the smallest ones are dropped."""

Polygon = Float[np.ndarray, "_ 2"]


@dataclass(frozen=True, eq=False)
class Region:
    """Positions ``origin + axes u`` with ``A u <= b``, contact frame ``rotation``; ``corners_m`` are the vertices.

    ``outside`` are the edges of obstacles outside of which the whole region is.
    """

    surface: str
    origin_m: Vector3
    axes: Float[np.ndarray, "3 d"]
    A: Float[np.ndarray, "m d"]
    b: Float[np.ndarray, "m"]
    rotation: Rotation
    corners_m: Points
    outside: OutsideEdges = field(default_factory=dict)


def foothold_regions(
    terrain: Terrain,
    friction: float,
    shape: EffectorLimits,
    yaw_rad: float,
    edge_margin_m: float,
    obstacles: Sequence[Obstacle] = (),
) -> list[Region]:
    """Regions of a sole on boxes that are not too steep for their friction, or of a hand on rails.

    Regions of soles are divided by the edges of ``obstacles``.
    """
    if shape.kind == "point":
        return [_rail_region(rail, yaw_rad, edge_margin_m) for rail in terrain.rails if not is_vertical(rail)]
    result: list[Region] = []
    for box in terrain.boxes:
        face = contact_area(box)
        mu = friction if box.friction is None else box.friction
        if face.normal[2] >= np.cos(np.arctan(mu)) - 1e-9:
            result += _face_regions(face, terrain, shape, yaw_rad, edge_margin_m, obstacles)
    return result


def contact_frame(normal: Vector3, ahead: Vector3) -> Rotation:
    """Contact frame with z along the normal and x along the projection of ``ahead`` onto the surface."""
    x = ahead - (ahead @ normal) * normal
    x = x / np.linalg.norm(x)
    return np.column_stack([x, np.cross(normal, x), normal])


def _rail_region(rail: Rail, yaw_rad: float, gap_m: float) -> Region:
    line = contact_area(rail)
    d = line.frame[:, 0]
    forward = d if d @ _heading_vector(yaw_rad) >= 0.0 else -d
    half = float(line.half_m[0])
    half -= min(gap_m, 0.9 * half)
    ends = line.center_m + np.outer([-half, half], d)
    A = np.array([[1.0], [-1.0]])
    return Region(
        rail.name, line.center_m, d[:, np.newaxis], A, np.full(2, half), contact_frame(line.normal, forward), ends
    )


def _face_regions(
    face: ContactArea,
    terrain: Terrain,
    shape: EffectorLimits,
    yaw_rad: float,
    gap_m: float,
    obstacles: Sequence[Obstacle],
) -> list[Region]:
    R = contact_frame(face.normal, _heading_vector(yaw_rad))
    signs = np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)]) * shape.half_size_m
    sole = signs @ R[:, :2].T @ face.frame[:, :2]
    half_extent = face.half_m - np.abs(sole).max(axis=0)
    if half_extent.min() < 0.0:
        return []
    pieces: list[Polygon] = [np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)]) * half_extent]
    for box in terrain.boxes:
        if box is not face.surface and (blocked := _blocked_by_box(face, box, sole)) is not None:
            pieces = _subtract_obstacle(pieces, blocked)
    cells: list[tuple[Polygon, OutsideEdges]] = [(piece, {}) for piece in pieces]
    signs = np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)])
    heights = face.center_m[2] + (signs * face.half_m) @ face.frame[2, :2]
    low, high = float(heights.min()), float(heights.max())
    for obstacle in obstacles:
        if obstacle.name != face.surface.name and obstacle.is_in_way(low, high):
            offsets = obstacle.grown_offsets_m(low, shape, yaw_rad)
            cells = list(_cells_around(cells, obstacle, offsets, face))
    cells = sorted(cells, key=lambda cell: _area(cell[0]), reverse=True)[:PIECES_MAX]
    candidates = (_shrunk_region(face, piece, R, gap_m, outside) for piece, outside in cells)
    return [region for region in candidates if region is not None]


def _cells_around(
    cells: Iterable[tuple[Polygon, OutsideEdges]],
    obstacle: Obstacle,
    offsets_m: Float[np.ndarray, "m"],
    face: ContactArea,
) -> Iterator[tuple[Polygon, OutsideEdges]]:
    """Divide cells of a face by the lines of an obstacle's edges and drop what is inside of all of them."""
    E = face.frame[:2, :2]
    for piece, outside in cells:
        parts: list[tuple[Polygon, frozenset[int]]] = [(piece, frozenset())]
        for i, (n, offset) in enumerate(zip(obstacle.normals, offsets_m, strict=True)):
            normal, b = n @ E, float(offset - n @ face.center_m[:2])
            parts = [
                (part, edges | beyond)
                for polygon, edges in parts
                for part, beyond in (
                    (_clip_polygon(polygon, normal, b), frozenset[int]()),
                    (_clip_polygon(polygon, -normal, -b), frozenset({i})),
                )
                if len(part) > 2 and _area(part) >= MIN_AREA_M2
            ]
        yield from ((part, {**outside, obstacle.name: edges}) for part, edges in parts if edges)


def _blocked_by_box(face: ContactArea, box: Box, sole: Polygon) -> Float[np.ndarray, "m 3"] | None:
    """Half-planes ``n x <= b`` (rows ``n, b``) whose intersection is blocked for the sole's centre; None if free."""
    low, high = BLOCKING_LAYER_M
    signs = np.array(np.meshgrid(*[(-0.5, 0.5)] * 3)).reshape(3, -1).T
    corners = (box.placement.act(signs * box.size_m) - face.center_m) @ face.frame
    z = corners[:, 2]
    if z.max() <= low or z.min() >= high:
        return None
    points = [corners[(z >= low) & (z <= high), :2]]
    edges = [(i, k) for i in range(8) for k in range(i) if np.count_nonzero(signs[i] != signs[k]) == 1]
    for level in BLOCKING_LAYER_M:
        for i, k in edges:
            if (z[i] - level) * (z[k] - level) < 0.0:
                share = (level - z[i]) / (z[k] - z[i])
                points.append((corners[i] + share * (corners[k] - corners[i]))[np.newaxis, :2])
    outline = np.concatenate(points)
    grown = (outline[:, np.newaxis] - sole[np.newaxis]).reshape(-1, 2)
    equations = np.unique(np.round(ConvexHull(grown).equations, 12), axis=0)
    return np.column_stack([equations[:, :2], -equations[:, 2]])


def _subtract_obstacle(pieces: list[Polygon], blocked: Float[np.ndarray, "m 3"]) -> list[Polygon]:
    remainder: list[Polygon] = []
    for piece in pieces:
        inside = piece
        for x, y, b in blocked:
            inside = _clip_polygon(inside, np.array([x, y]), b)
        if _area(inside) < MIN_AREA_M2:
            remainder.append(piece)
        else:
            remainder += [_clip_polygon(piece, np.array([-x, -y]), -b) for x, y, b in blocked]
    distinct: list[Polygon] = []
    for piece in sorted(remainder, key=_area, reverse=True):
        if len(piece) and not any(_contains(other, piece) for other in distinct):
            distinct.append(piece)
    return distinct[:PIECES_MAX]


def _clip_polygon(polygon: Polygon, n: Float[np.ndarray, "2"], b: float) -> Polygon:
    """The part of a polygon with ``n x <= b`` (Sutherland & Hodgman)."""
    return np.array(list(_clipped_vertices(polygon, n, b))).reshape(-1, 2)


def _clipped_vertices(polygon: Polygon, n: Float[np.ndarray, "2"], b: float) -> Iterator[Float[np.ndarray, "2"]]:
    over = polygon @ n - b
    for i in range(len(polygon)):
        k = (i + 1) % len(polygon)
        if over[i] <= 1e-9:
            yield polygon[i]
        if (over[i] > 1e-9) != (over[k] > 1e-9):
            yield polygon[i] + over[i] / (over[i] - over[k]) * (polygon[k] - polygon[i])


def _area(polygon: Polygon) -> float:
    x, y = polygon.T
    return float(abs(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1))) / 2)


def _contains(outer: Polygon, inner: Polygon) -> bool:
    edges = np.roll(outer, -1, axis=0) - outer
    n = np.column_stack([edges[:, 1], -edges[:, 0]])
    return bool(((inner[:, np.newaxis] - outer) * n).sum(axis=2).max() <= 1e-9)


def _shrunk_region(
    face: ContactArea, polygon: Polygon, R: Rotation, gap_m: float, outside: OutsideEdges
) -> Region | None:
    A, b = _half_planes(polygon)
    margin_m = gap_m
    if not _holds_circle(polygon, A, b, gap_m / INRADIUS_SHARE):
        lengths = np.ones((len(A), 1))
        circle = linprog([0, 0, -1], np.hstack([A, lengths]), b, bounds=[(None, None), (None, None), (0, None)])
        if circle.status != 0:
            return None
        margin_m = min(gap_m, INRADIUS_SHARE * float(circle.x[2]))
    b = b - margin_m
    for n, offset in zip(A, b, strict=True):
        polygon = _clip_polygon(polygon, n, float(offset))
    corners = face.center_m + polygon @ face.frame[:, :2].T
    if not len(polygon):
        return None
    return Region(face.surface.name, face.center_m, face.frame[:, :2], A, b, R, corners, outside)


def _holds_circle(polygon: Polygon, A: Float[np.ndarray, "m 2"], b: Float[np.ndarray, "m"], radius_m: float) -> bool:
    """Whether a circle of ``radius_m`` around a point of the polygon satisfies ``A x <= b``; no if it just does."""
    centres = polygon
    for n, offset in zip(A, b - radius_m - 1e-6, strict=True):
        centres = _clip_polygon(centres, n, float(offset))
    return len(centres) > 0


def _half_planes(polygon: Polygon) -> tuple[Float[np.ndarray, "m 2"], Float[np.ndarray, "m"]]:
    """Half-planes of a convex polygon; of its bounding rectangle if it has no width."""
    try:
        equations = ConvexHull(polygon).equations
    except QhullError:
        axes = np.vstack([np.eye(2), -np.eye(2)])
        return axes, (polygon @ axes.T).max(axis=0)
    equations = np.unique(np.round(equations, 12), axis=0)
    return equations[:, :2], -equations[:, 2]


def _heading_vector(yaw_rad: float) -> Vector3:
    return np.array([np.cos(yaw_rad), np.sin(yaw_rad), 0.0])
