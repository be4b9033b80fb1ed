"""Planes of a terrain on which feet can stand: axes, covered cells, and the exact ones of clean meshes.

A group of triangles is exact if nearly all triangles near its plane belong to it. In a scan with noise triangles point
in all directions, and a group has only a share of them; its planes are fitted by ``growing``.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from jaxtyping import Bool, Float
from scipy import ndimage

from stridelab.contacts.terrain_meshes.reading import TerrainMesh
from stridelab.contacts.terrain_meshes.rectangles import Cells, turn_cells
from stridelab.conventions import Mask, Points, Rotation

STEEPEST_RAD: Final = float(np.deg2rad(35.0))
SAME_PLANE_RAD: Final = float(np.deg2rad(2.0))
SAME_PLANE_M: Final = 5e-3
HEADROOM_M: Final = 1.8
SHORTEST_EDGE_M: Final = 0.1
"""Half the length of a sole: smaller faces hold no foot."""
CELL_M: Final = 0.02
MAX_CELLS: Final = 400
"""Along an edge of a group; larger groups have larger cells."""
MAX_PLANES: Final = 800
PURE_SHARE: Final = 0.9
"""Least share of the area near an exact plane that belongs to it."""
NEAR_M: Final = 0.02
"""Distance from an exact plane of the triangles that are compared with it."""
LEAST_UP: Final = 0.3
"""Vertical part of the normals of triangles that are compared with a plane."""
Corners2 = Float[np.ndarray, "m 3 2"]


@dataclass(frozen=True, eq=False)
class Plane:
    """A plane: axes, of which the third is its normal, its covered cells, and places ``(n, 2)`` in its axes.

    The places are vertices of exact planes, to which edges snap, and points of scanned ones, whose ``spacing_m`` is
    positive.
    """

    R: Rotation
    offset_m: float
    places_m: Float[np.ndarray, "n 2"]
    low_m: Float[np.ndarray, "2"]
    cell_m: float
    covered: Cells
    spacing_m: float = 0.0

    def place_in_world(self, places_m: Float[np.ndarray, "n 2"]) -> Points:
        """Points of the plane in the world."""
        return np.asarray(np.column_stack([places_m, np.full(len(places_m), self.offset_m)]) @ self.R.T)

    @cached_property
    def bounds_m(self) -> tuple[Float[np.ndarray, "2"], Float[np.ndarray, "2"]]:
        """Lower and upper corner of the covered cells in plan."""
        extent_m = self.cell_m * np.array(self.covered.shape)
        corners = self.low_m + np.array([(i, j) for i in (0, 1) for j in (0, 1)]) * extent_m
        plan = self.place_in_world(corners)[:, :2]
        return plan.min(axis=0), plan.max(axis=0)

    def is_near(self, other: "Plane") -> bool:
        """Whether the bounds of two planes overlap in plan."""
        (low, high), (other_low, other_high) = self.bounds_m, other.bounds_m
        return bool((low < other_high).all() and (other_low < high).all())

    def heights_above(self, points_m: Points) -> tuple[Float[np.ndarray, "n"], Mask]:
        """How far points of the world are above the plane, vertically, and which have a covered cell below or above."""
        normal = self.R[:, 2]
        above_m = (points_m @ normal - self.offset_m) / normal[2]
        on_plane = points_m - np.column_stack([np.zeros((len(points_m), 2)), above_m])
        cells = np.floor((on_plane @ self.R[:, :2] - self.low_m) / self.cell_m).astype(int)
        inside = ((cells >= 0) & (cells < self.covered.shape)).all(axis=1)
        covered = np.zeros(len(points_m), dtype=bool)
        covered[inside] = self.covered[tuple(cells[inside].T)]
        return np.asarray(above_m), np.asarray(covered)

    def covers_points(self, points_m: Points) -> Bool[np.ndarray, "n"]:
        """Which points of the world lie below a covered cell, within the headroom."""
        above_m, covered = self.heights_above(points_m)
        return np.asarray(covered & (above_m < -2.0 * SAME_PLANE_M) & (above_m > -HEADROOM_M))

    def turn_axes(self, turn_rad: float) -> "Plane":
        """The same plane with its axes turned about its normal."""
        covered, low = turn_cells(self.covered, turn_rad)
        c, s = np.cos(turn_rad), np.sin(turn_rad)
        to_new = np.array([[c, s], [-s, c]])
        R = np.column_stack([self.R[:, :2] @ to_new.T, self.R[:, 2]])
        low_m = to_new @ self.low_m + low * self.cell_m
        return Plane(R, self.offset_m, self.places_m @ to_new.T, low_m, self.cell_m, covered, self.spacing_m)


def exact_planes(mesh: TerrainMesh) -> tuple[list[Plane], Mask]:
    """Planes of groups of triangles that face up, and which triangles belong to none of them.

    The largest triangle of the others begins a group.
    """
    corners_m = mesh.vertices_m[mesh.triangles]
    areas = 0.5 * np.cross(corners_m[:, 1] - corners_m[:, 0], corners_m[:, 2] - corners_m[:, 0])
    size_m2 = np.linalg.norm(areas, axis=1)
    up = areas[:, 2] > np.cos(STEEPEST_RAD) * np.maximum(size_m2, 1e-10)
    normals = areas / np.maximum(size_m2, 1e-300)[:, None]
    compared = areas[:, 2] > LEAST_UP * np.maximum(size_m2, 1e-10)
    middles_m = corners_m.mean(axis=1)
    left, free = up.copy(), np.ones(len(size_m2), dtype=bool)
    planes = []
    for _ in range(MAX_PLANES):
        if not left.any():
            break
        seed = int(np.argmax(np.where(left, size_m2, -1.0)))
        n = normals[seed]
        away_m = np.abs((corners_m - corners_m[seed, 0]) @ n).max(axis=1)
        group = left & (normals @ n > np.cos(SAME_PLANE_RAD)) & (away_m < SAME_PLANE_M)
        left &= ~group
        if size_m2[group].sum() < SHORTEST_EDGE_M**2:
            if size_m2[seed] * left.sum() < SHORTEST_EDGE_M**2:
                break
            continue
        plane = _plane_of(corners_m[group], n)
        near = compared & (np.abs((middles_m - corners_m[seed, 0]) @ n) < NEAR_M)
        near[near] = _lie_about(plane, middles_m[near])
        if size_m2[group].sum() >= PURE_SHARE * size_m2[near | group].sum():
            planes.append(plane)
            free &= ~group
    return planes, free


def _lie_about(plane: Plane, points_m: Points) -> Mask:
    """Which points are above or below covered cells, or up to three cells aside."""
    wide = np.pad(plane.covered, 3)
    wide = np.asarray(ndimage.binary_dilation(wide, iterations=3))
    low_m = plane.low_m - 3 * plane.cell_m
    return Plane(plane.R, plane.offset_m, plane.places_m, low_m, plane.cell_m, wide).heights_above(points_m)[1]


def _plane_of(corners_m: Float[np.ndarray, "m 3 3"], normal: Float[np.ndarray, "3"]) -> Plane:
    """The plane of a group, with axes along its longest edges, and the cells that its triangles cover."""
    edges = (np.roll(corners_m, -1, axis=1) - corners_m).reshape(-1, 3)
    lengths = np.linalg.norm(edges, axis=1)
    R = axes_along(edges[_longest_side(edges, lengths)], normal)
    flat = corners_m @ R
    low_m, high_m = flat[..., :2].min(axis=(0, 1)), flat[..., :2].max(axis=(0, 1))
    cell_m = max(CELL_M, float((high_m - low_m).max()) / MAX_CELLS)
    covered = np.zeros(np.maximum(np.ceil((high_m - low_m) / cell_m - 1e-9).astype(int), 1), dtype=bool)
    for triangle in flat[..., :2]:
        _mark_covered(covered, (triangle - low_m) / cell_m)
    return Plane(R, float(flat[..., 2].mean()), flat[..., :2].reshape(-1, 2), low_m, cell_m, covered)


def axes_along(direction: Float[np.ndarray, "3"], normal: Float[np.ndarray, "3"]) -> Rotation:
    """Axes of a plane, one along a direction in it; the first is the one nearest to x."""
    along = direction / np.linalg.norm(direction)
    across = np.cross(normal, along)
    x = max((along, across, -along, -across), key=lambda one: float(one[0]))
    return np.column_stack([x, np.cross(normal, x), normal])


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


def block_below(free: Cells, plane: Plane, planes: Sequence[Plane]) -> None:
    """Mark the free cells as not free that another plane covers within the headroom."""
    at = np.argwhere(free)
    centres_m = plane.place_in_world(plane.low_m + (at + 0.5) * plane.cell_m)
    for other in planes:
        if other is not plane and other.is_near(plane):
            free[tuple(at[other.covers_points(centres_m)].T)] = False
