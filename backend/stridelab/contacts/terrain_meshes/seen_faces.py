"""Obstacles of faces that are seen from one side only, and of what has no faces.

Walls, soffits and steep ground of a scan are thin boxes about their planes, in rectangles that leave doors and windows
open. What belongs to no plane, such as a column or furniture, is a box over each part of the plan that it covers.
"""

from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np
from jaxtyping import Float
from scipy import ndimage

from stridelab.contacts.terrain_meshes.growing import Region, close_holes
from stridelab.contacts.terrain_meshes.rectangles import Cells, has_square, largest_rectangle
from stridelab.contacts.terrain_meshes.samples import Samples
from stridelab.contacts.terrain_meshes.shapes import Solid
from stridelab.conventions import Mask, Points, Rotation
from stridelab.dynamics.spatial import Placement

THICK_M: Final = 0.04
FACE_CELL_M: Final = 0.04
CLOSED_M: Final = 0.12
"""Radius of holes in a face that are closed: nothing passes there."""
OPEN_M: Final = 0.4
"""Edge of a free square that makes a face one with an opening."""
LEAST_FACE_M: Final = 0.15
LEAST_FACE_M2: Final = 0.04
MAX_PARTS: Final = 16
VOXEL_M: Final = 0.1
COLUMN_M: Final = 0.5
"""Edge in plan of a box of what has no faces."""
LEAST_POINTS: Final = 30
LEAST_CLUTTER_M: Final = 0.1
UP: Final = np.array([0.0, 0.0, 1.0])


def axes_of_face(normal: Float[np.ndarray, "3"]) -> Rotation:
    """Axes of a face: a level one along it, the steepest one, and its normal."""
    along = np.cross(UP, normal) if abs(normal[2]) < 0.999 else np.array([1.0, 0.0, 0.0])
    along /= np.linalg.norm(along)
    return np.column_stack([along, np.cross(normal, along), normal])


def cover_face(samples: Samples, points_m: Points, R: Rotation) -> tuple[Cells, Float[np.ndarray, "2"], float]:
    """Cells that the points of a face cover, holes closed, with their lower corner and their edge (m)."""
    cell_m = max(FACE_CELL_M, 2.0 * samples.spacing_m)
    flat = points_m @ R[:, :2]
    margin = int(np.ceil(CLOSED_M / cell_m)) + 1
    low_m = flat.min(axis=0) - margin * cell_m
    at = np.floor((flat - low_m) / cell_m).astype(int)
    covered = np.zeros(at.max(axis=0) + margin + 1, dtype=bool)
    covered[tuple(at.T)] = True
    return close_holes(covered, CLOSED_M / cell_m), low_m, cell_m


def has_opening(samples: Samples, region: Region, R: Rotation) -> bool:
    """Whether a face has a door or a window in it."""
    covered, _, cell_m = cover_face(samples, samples.points_m[region.members], R)
    rows, columns = np.flatnonzero(covered.any(axis=1)), np.flatnonzero(covered.any(axis=0))
    inner = covered[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    return has_square(~inner, round(OPEN_M / cell_m))


def thin_boxes(samples: Samples, region: Region, outside: Mask) -> Iterator[Solid]:
    """Boxes about the plane of a region over its points that are ``outside`` of all other boxes."""
    points_m = samples.points_m[region.members & outside]
    if len(points_m) * samples.spacing_m**2 < LEAST_FACE_M2:
        return
    R = axes_of_face(region.normal)
    flat_m = points_m @ R[:, :2]
    offset_m = float(region.middle_m @ region.normal)
    covered, low_m, cell_m = cover_face(samples, points_m, R)
    covered = np.asarray(ndimage.binary_dilation(covered, np.ones((3, 3))))  # cells at edges are seen in part
    for _ in range(MAX_PARTS):
        (i, j), (k, m) = largest_rectangle(covered, max(int(LEAST_FACE_M / cell_m), 1))
        first, last = low_m + cell_m * np.array([i, j]), low_m + cell_m * np.array([k, m])
        inside = flat_m[((flat_m > first) & (flat_m < last)).all(axis=1)]
        covered[i:k, j:m] = False
        if len(inside) * samples.spacing_m**2 < LEAST_FACE_M2:
            return
        lowest, highest = np.quantile(inside, [0.01, 0.99], axis=0)
        size_m = highest - lowest
        if size_m.min() < LEAST_FACE_M:
            continue
        middle = np.append(0.5 * (lowest + highest), offset_m)
        yield Solid(Placement(R @ middle, R), np.append(size_m, THICK_M))


def clutter_boxes(points_m: Points) -> list[Solid]:
    """Boxes of connected points that belong to no plane: over each square of the plan that they cover."""
    if len(points_m) < LEAST_POINTS:
        return []
    low_m = points_m.min(axis=0)
    at = np.floor((points_m - low_m) / VOXEL_M).astype(int)
    if np.prod(at.max(axis=0) + 1.0) > 2e7:
        return []
    full = np.zeros(at.max(axis=0) + 1, dtype=bool)
    full[tuple(at.T)] = True
    labels = ndimage.label(full)[0][tuple(at.T)]
    counts = np.bincount(labels)
    solids = []
    for label in np.flatnonzero(counts >= LEAST_POINTS):
        part_m = points_m[labels == label]
        if np.ptp(part_m, axis=0).max() < LEAST_CLUTTER_M:
            continue
        squares = np.floor((part_m[:, :2] - part_m[:, :2].min(axis=0)) / COLUMN_M).astype(int)
        for square in np.unique(squares, axis=0):
            column_m = part_m[(squares == square).all(axis=1)]
            if len(column_m) >= 3:
                low, high = column_m.min(axis=0), np.maximum(column_m.max(axis=0), column_m.min(axis=0) + 0.02)
                solids.append(Solid(Placement(0.5 * (low + high), np.eye(3)), high - low))
    return solids


def steep_regions(regions: Sequence[Region], least_up: float) -> list[Region]:
    """Regions on which no foot stands."""
    return [one for one in regions if abs(one.normal[2]) <= least_up]
