"""Bars and boxes of a terrain: their triangles, and which closed parts of a mesh are one."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from jaxtyping import Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from stridelab.contacts.terrain_meshes.reading import TerrainMesh
from stridelab.conventions import Mask, Points, Rotation, Vector3
from stridelab.dynamics.spatial import Placement

EXACT_M: Final = 1e-3
"""Distance from its box up to which the vertices of a part are on it."""
MERGED_M: Final = 1e-6
LONG: Final = 5.0
"""Least ratio of a bar's length and its thickness."""
ROUND_CORNERS: Final = 6
MAX_PARTS: Final = 3_000
MAX_PART_TRIANGLES: Final = 20_000
INSIDE_M: Final = 0.03
"""How far beyond a box a face is still its own."""
Faces = Int[np.ndarray, "m 3"]
Frame = tuple[Rotation, Vector3, Vector3]
"""Axes of a box, its centre, and half its edges with what is beside it."""


@dataclass(frozen=True, eq=False)
class Bar:
    """A round bar: ends of its axis, and its radius."""

    from_m: Vector3
    to_m: Vector3
    radius_m: float


@dataclass(frozen=True, eq=False)
class Solid:
    """A box: placement of its centre, and its edges."""

    placement: Placement
    size_m: Vector3


def solid_mesh(solid: Solid) -> tuple[Points, Faces]:
    """Corners and triangles of a box."""
    signs = np.array([(i, j, k) for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)], float)
    corners_m = solid.placement.position_m + (0.5 * signs * solid.size_m) @ solid.placement.rotation.T
    squares = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
    faces = [face for a, b, c, d in squares for face in ((a, b, c), (a, c, d))]
    return corners_m, np.array(faces, dtype=np.int64)


def cylinder_mesh(bar: Bar, sectors: int) -> tuple[Points, Faces]:
    """Corners and triangles of a closed cylinder."""
    d = bar.to_m - bar.from_m
    d = d / max(float(np.linalg.norm(d)), 1e-12)
    u = np.cross(d, [1.0, 0.0, 0.0] if abs(d[0]) < 0.9 else [0.0, 1.0, 0.0])
    u /= np.linalg.norm(u)
    turn = 2.0 * np.pi * np.arange(sectors) / sectors
    ring = bar.radius_m * (np.outer(np.cos(turn), u) + np.outer(np.sin(turn), np.cross(d, u)))
    vertices_m = np.concatenate([bar.from_m + ring, bar.to_m + ring, bar.from_m[None], bar.to_m[None]])
    faces = []
    for k in range(sectors):
        m = (k + 1) % sectors
        faces += [(k, m, sectors + m), (k, sectors + m, sectors + k)]
        faces += [(2 * sectors, m, k), (2 * sectors + 1, sectors + k, sectors + m)]
    return vertices_m, np.array(faces, dtype=np.int64)


def lie_in_boxes(boxes: Sequence[Mapping[str, Any]], points_m: Points, beside_m: float = INSIDE_M) -> Mask:
    """Which points are inside a box, or at most ``beside_m`` beside it."""
    return lie_in_frames(frames_of_boxes(boxes, beside_m), points_m)


def frames_of_boxes(boxes: Sequence[Mapping[str, Any]], beside_m: float = INSIDE_M) -> list[Frame]:
    """Frames of the boxes of a terrain."""
    return [
        (
            Placement.from_wxyz(box["center_m"], box["orientation_wxyz"]).rotation,
            np.array(box["center_m"]),
            0.5 * np.array(box["size_m"]) + beside_m,
        )
        for box in boxes
    ]


def lie_in_frames(frames: Sequence[Frame], points_m: Points) -> Mask:
    """Which points are in a frame."""
    inside = np.zeros(len(points_m), dtype=bool)
    low, high = points_m.min(axis=0, initial=np.inf), points_m.max(axis=0, initial=-np.inf)
    for R, center_m, half_m in frames:
        reach_m = np.abs(R) @ half_m
        if (center_m - reach_m < high).all() and (center_m + reach_m > low).all():
            inside |= (np.abs((points_m - center_m) @ R) <= half_m).all(axis=1)
    return inside


def shapes_of_parts(mesh: TerrainMesh) -> tuple[list[Bar], list[Solid]]:
    """Connected parts of a mesh that are a long bar, round or square, or a box."""
    bars, solids = [], []
    if len(mesh.triangles) == 0:
        return [], []
    cubes = np.round(mesh.vertices_m / MERGED_M).astype(np.int64)
    merged = np.unique(cubes, axis=0, return_inverse=True)[1].reshape(-1)
    triangles = merged[mesh.triangles]
    pairs = np.concatenate([triangles[:, :2], triangles[:, 1:]])
    size = int(merged.max()) + 1
    graph = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(size, size))
    labels = connected_components(graph, directed=False)[1]
    part = labels[triangles[:, 0]]
    order = np.argsort(part, kind="stable")
    groups = np.split(order, np.flatnonzero(np.diff(part[order])) + 1)
    for group in groups[:MAX_PARTS]:
        if len(group) > MAX_PART_TRIANGLES:
            continue
        corners_m = mesh.vertices_m[mesh.triangles[group]]
        vertices_m = np.unique(corners_m.reshape(-1, 3).round(7), axis=0)
        solid = _fit_solid(corners_m, vertices_m)
        if solid is not None:
            solids.append(solid)
        bar = _fit_bar(vertices_m) if solid is None else _bar_of_solid(solid)
        if bar is not None:
            bars.append(bar)
    return bars, solids


def _fit_solid(corners_m: np.ndarray, vertices_m: Points) -> Solid | None:
    """The box of a part all of whose vertices are at its corners, with its z axis as near upright as it can be."""
    if not 8 <= len(vertices_m) <= 64:
        return None
    normals = np.cross(corners_m[:, 1] - corners_m[:, 0], corners_m[:, 2] - corners_m[:, 0])
    areas = np.linalg.norm(normals, axis=1)
    normals = normals[areas > 1e-12] / areas[areas > 1e-12, None]
    z = normals[int(np.argmax(np.abs(normals[:, 2])))]
    z = z if z[2] > 0.0 else -z
    across = normals[np.abs(normals @ z) < 1e-3]
    if len(across) == 0:
        return None
    x = across[int(np.argmax(across[:, 0]))]
    R = np.column_stack([x, np.cross(z, x), z])
    if not (np.abs(normals @ R).max(axis=1) > 1.0 - 1e-6).all():
        return None
    local = vertices_m @ R
    low, high = local.min(axis=0), local.max(axis=0)
    at_corner = np.minimum(np.abs(local - low), np.abs(local - high)).max(axis=1) < EXACT_M
    if not at_corner.all() or (high - low).min() < EXACT_M:
        return None
    return Solid(Placement(R @ (0.5 * (low + high)), R), high - low)


def _bar_of_solid(solid: Solid) -> Bar | None:
    """The bar of a long box with a square section, about."""
    order = np.argsort(solid.size_m)
    thin, thick, long = solid.size_m[order]
    if long < LONG * thick or thick > 2.0 * thin:
        return None
    axis = solid.placement.rotation[:, int(order[2])]
    c = solid.placement.position_m
    return Bar(c - 0.5 * long * axis, c + 0.5 * long * axis, float(0.25 * (thin + thick)))


def _fit_bar(vertices_m: Points) -> Bar | None:
    """The bar of a long part whose vertices are on a cylinder."""
    if len(vertices_m) < 2 * ROUND_CORNERS:
        return None
    middle = 0.5 * (vertices_m.min(axis=0) + vertices_m.max(axis=0))
    local = vertices_m - vertices_m.mean(axis=0)
    d = np.linalg.eigh(local.T @ local)[1][:, 2]
    along = (vertices_m - middle) @ d
    length = float(np.ptp(along))
    ends = np.abs(along - along.min()) < 0.02 * length, np.abs(along - along.max()) < 0.02 * length
    if min(ends[0].sum(), ends[1].sum()) < ROUND_CORNERS:
        return None
    a, b = (0.5 * (vertices_m[end].min(axis=0) + vertices_m[end].max(axis=0)) for end in ends)
    d = (b - a) / np.linalg.norm(b - a)
    off = vertices_m - a - np.outer((vertices_m - a) @ d, d)
    away = np.linalg.norm(off, axis=1)
    radius_m = float(away.max())
    on_axis = away < 0.1 * radius_m
    is_round = (np.abs(away - radius_m) < 0.05 * radius_m) | on_axis
    if length < LONG * 2.0 * radius_m or not is_round.all():
        return None
    along = (vertices_m - a) @ d
    return Bar(a + along.min() * d, a + along.max() * d, radius_m)
