"""Rectangles on which feet can stand, found in the mesh of a terrain.

Triangles that face up within ``STEEPEST_RAD`` are grouped by planes. In each plane, on a grid, cells are free that a
triangle of the group covers and that no other standable triangle covers within ``HEADROOM_M`` above. The largest free
rectangles become boxes with that upper face. Edges of rectangles snap to vertices less than a cell away, so that faces
of stairs and ramps keep their size. Level surfaces are solid down to the lowest point of the mesh, tilted ones are
slabs.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from jaxtyping import Bool, Float, Int

from stridelab.contacts.scenarios.parts import round_values
from stridelab.contacts.terrain_meshes.reading import TerrainMesh
from stridelab.conventions import Points, Rotation
from stridelab.dynamics.spatial import Placement

STEEPEST_RAD: Final = float(np.deg2rad(35.0))
SAME_PLANE_RAD: Final = float(np.deg2rad(2.0))
SAME_PLANE_M: Final = 5e-3
HEADROOM_M: Final = 1.8
SHORTEST_EDGE_M: Final = 0.1
"""Half the length of a sole: smaller faces hold no foot."""
CELL_M: Final = 0.02
MAX_CELLS: Final = 400
"""Along an edge of a group; larger groups have larger cells."""
MAX_SURFACES: Final = 199
"""Of a terrain, which may have a rail beside them."""
SLAB_M: Final = 0.05
LEVEL_RAD: Final = float(np.deg2rad(0.5))
Cells = Bool[np.ndarray, "nx ny"]


@dataclass(frozen=True, eq=False)
class _Plane:
    """Triangles of a plane: corners ``(m, 3, 2)`` in its axes, of which the third is its normal."""

    R: Rotation
    offset_m: float
    corners_m: Float[np.ndarray, "m 3 2"]
    low_m: Float[np.ndarray, "2"]
    cell_m: float
    covered: Cells

    def place_in_world(self, places_m: Float[np.ndarray, "n 2"]) -> Points:
        """Points of the plane in the world."""
        return np.asarray(np.column_stack([places_m, np.full(len(places_m), self.offset_m)]) @ self.R.T)

    def covers_points(self, points_m: Points) -> Bool[np.ndarray, "n"]:
        """Which points of the world lie below a covered cell, within the headroom."""
        normal = self.R[:, 2]
        above_m = (self.offset_m - points_m @ normal) / normal[2]
        on_plane = points_m + np.column_stack([np.zeros((len(points_m), 2)), above_m])
        cells = np.floor((on_plane @ self.R[:, :2] - self.low_m) / self.cell_m).astype(int)
        inside = ((cells >= 0) & (cells < self.covered.shape)).all(axis=1)
        covered = np.zeros(len(points_m), dtype=bool)
        covered[inside] = self.covered[tuple(cells[inside].T)]
        return np.asarray(covered & (above_m > 2.0 * SAME_PLANE_M) & (above_m < HEADROOM_M))


def standing_surfaces(mesh: TerrainMesh) -> list[dict[str, Any]]:
    """Boxes of a scenario's terrain (``BoxSurface``), from the largest on, at most ``MAX_SURFACES``."""
    planes = list(_group_planes(mesh))
    boxes: list[tuple[float, dict[str, Any]]] = []
    floor_m = float(mesh.vertices_m[mesh.triangles.ravel(), 2].min())
    for plane in planes:
        free = plane.covered.copy()
        at = np.argwhere(free)
        centres_m = plane.place_in_world(plane.low_m + (at + 0.5) * plane.cell_m)
        for other in planes:
            if other is not plane:
                free[tuple(at[other.covers_points(centres_m)].T)] = False
        for low_m, high_m in _free_rectangles(plane, free):
            edges_m = high_m - low_m
            if edges_m.min() >= SHORTEST_EDGE_M:
                boxes.append((float(edges_m.prod()), _box_below(plane, low_m, high_m, floor_m)))
    boxes.sort(key=lambda one: -one[0])
    return [{"name": f"surface {k + 1}"} | box for k, (_, box) in enumerate(boxes[:MAX_SURFACES])]


def _group_planes(mesh: TerrainMesh) -> Iterator[_Plane]:
    """Groups of triangles of one plane that face up; the largest triangle of the others begins a group."""
    corners_m = mesh.vertices_m[mesh.triangles]
    areas = 0.5 * np.cross(corners_m[:, 1] - corners_m[:, 0], corners_m[:, 2] - corners_m[:, 0])
    size_m2 = np.linalg.norm(areas, axis=1)
    up = areas[:, 2] > np.cos(STEEPEST_RAD) * np.maximum(size_m2, 1e-10)
    corners_m, size_m2 = corners_m[up], size_m2[up]
    normals = areas[up] / size_m2[:, None]
    left = np.ones(len(size_m2), dtype=bool)
    for _ in range(4 * MAX_SURFACES):
        if not left.any():
            return
        seed = int(np.argmax(np.where(left, size_m2, -1.0)))
        n = normals[seed]
        away_m = np.abs((corners_m - corners_m[seed, 0]) @ n).max(axis=1)
        group = left & (normals @ n > np.cos(SAME_PLANE_RAD)) & (away_m < SAME_PLANE_M)
        left &= ~group
        if size_m2[group].sum() >= SHORTEST_EDGE_M**2:
            yield _plane_of(corners_m[group], n)


def _plane_of(corners_m: Float[np.ndarray, "m 3 3"], normal: Float[np.ndarray, "3"]) -> _Plane:
    """The plane of a group, with axes along its longest edges, and the cells that its triangles cover."""
    edges = (np.roll(corners_m, -1, axis=1) - corners_m).reshape(-1, 3)
    lengths = np.linalg.norm(edges, axis=1)
    longest = edges[_longest_side(edges, lengths)]
    along = longest / np.linalg.norm(longest)
    across = np.cross(normal, along)
    x = max((along, across, -along, -across), key=lambda one: float(one[0]))
    R = np.column_stack([x, np.cross(normal, x), normal])
    flat = corners_m @ R
    low_m, high_m = flat[..., :2].min(axis=(0, 1)), flat[..., :2].max(axis=(0, 1))
    cell_m = max(CELL_M, float((high_m - low_m).max()) / MAX_CELLS)
    covered = np.zeros(np.maximum(np.ceil((high_m - low_m) / cell_m - 1e-9).astype(int), 1), dtype=bool)
    for triangle in flat[..., :2]:
        _mark_covered(covered, (triangle - low_m) / cell_m)
    return _Plane(R, float(flat[..., 2].mean()), flat[..., :2], low_m, cell_m, covered)


def _longest_side(edges: Points, lengths: Float[np.ndarray, "n"]) -> int:
    """The longest edge of the direction, or of the one across it, in which the edges are longest in all."""
    bins = np.round(np.rad2deg(np.arctan2(edges[:, 1], edges[:, 0]))).astype(int) % 90
    favoured = int(np.argmax(np.bincount(bins, weights=lengths, minlength=90)))
    return int(np.argmax(np.where(bins == favoured, lengths, -1.0)))


def _mark_covered(covered: Cells, triangle: Float[np.ndarray, "3 2"]) -> None:
    """Mark the cells whose centre lies in a triangle, given in cells."""
    low = np.clip(np.floor(triangle.min(axis=0)).astype(int), 0, covered.shape)
    high = np.clip(np.ceil(triangle.max(axis=0)).astype(int), 0, covered.shape)
    x, y = np.meshgrid(np.arange(low[0], high[0]) + 0.5, np.arange(low[1], high[1]) + 0.5, indexing="ij")
    sides = [
        (b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0])
        for a, b in zip(triangle, np.roll(triangle, -1, axis=0), strict=True)
    ]
    inside = np.all([side >= -1e-9 for side in sides], axis=0) | np.all([side <= 1e-9 for side in sides], axis=0)
    covered[low[0] : high[0], low[1] : high[1]] |= inside


def _free_rectangles(plane: _Plane, free: Cells) -> Iterator[tuple[Float[np.ndarray, "2"], Float[np.ndarray, "2"]]]:
    """Lower and upper corners of the largest free rectangle, of the largest in what it leaves, and so on."""
    places_m = plane.corners_m.reshape(-1, 2)
    for _ in range(MAX_SURFACES):
        (i, j), (k, m) = _largest_rectangle(free)
        if min(k - i, m - j) * plane.cell_m < SHORTEST_EDGE_M - plane.cell_m:
            return
        free[i:k, j:m] = False
        ends_m = plane.low_m + plane.cell_m * np.array([(i, j), (k, m)])
        for end, inwards_m in ((0, 0.5 * plane.cell_m), (1, -0.5 * plane.cell_m)):
            for axis in range(2):
                apart_m = np.abs(places_m[:, axis] - ends_m[end, axis])
                nearest = int(np.argmin(apart_m))
                snaps = apart_m[nearest] < plane.cell_m
                ends_m[end, axis] = places_m[nearest, axis] if snaps else ends_m[end, axis] + inwards_m
        yield ends_m[0], ends_m[1]


def _largest_rectangle(free: Cells) -> tuple[tuple[int, int], tuple[int, int]]:
    """First cell of the largest rectangle of free cells, and the one after its last; by the heights of columns."""
    best, found = 0, ((0, 0), (0, 0))
    heights: Int[np.ndarray, "ny"] = np.zeros(free.shape[1], dtype=int)
    for row in range(free.shape[0]):
        heights = np.where(free[row], heights + 1, 0)
        stack: list[tuple[int, int]] = []
        for column, height in enumerate([*heights.tolist(), 0]):
            start = column
            while stack and stack[-1][1] >= height:
                start, top = stack.pop()
                if top * (column - start) > best:
                    best, found = top * (column - start), ((row - top + 1, start), (row + 1, column))
            stack.append((start, height))
    return found


def _box_below(
    plane: _Plane, low: Float[np.ndarray, "2"], high: Float[np.ndarray, "2"], floor_m: float
) -> dict[str, Any]:
    """A box whose upper face is a rectangle of a plane."""
    top_m = plane.place_in_world((0.5 * (low + high))[None])[0]
    is_level = plane.R[2, 2] > np.cos(LEVEL_RAD)
    depth_m = max(float(top_m[2]) - floor_m, SLAB_M) if is_level else SLAB_M
    return {
        "kind": "box",
        "center_m": round_values((top_m - 0.5 * depth_m * plane.R[:, 2]).tolist()),
        "size_m": round_values((*(high - low).tolist(), depth_m)),
        "orientation_wxyz": round_values(Placement(top_m, plane.R).wxyz.tolist()),
    }
