"""Which axis of a file points up: by the area that is level with each axis, and what lies on either side of it.

The axis of the format is taken back only where the points are clear about another one: where they are seen from a
depth camera at the origin, where another axis has the rises of stairs, where hardly anything is level, or where the
terrain would be a tower.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float

from stridelab.contacts.terrain_meshes.reading import UP_AXES, UpAxis
from stridelab.contacts.terrain_meshes.samples import estimate_normals, thin_points
from stridelab.conventions import Mask, Points, Series

MAX_POINTS: Final = 20_000
LEVEL: Final = float(np.cos(np.deg2rad(15.0)))
LEAST_SHARE: Final = 0.1
"""Area along the axis of the format, in that along another one, below which the other one is clear."""
CLIMBED_SHARE: Final = 0.3
"""Least area of the treads of stairs, in the level area along the axis of the format."""
CLIMBED_POINTS: Final = 0.1
"""Least share of the points that are on treads and floors of stairs."""
TOWER: Final = 1.5
"""Height over the longer horizontal extent from which on a terrain is a tower, if another axis has more area."""
BIN_M: Final = 0.04
LEAST_LEVEL: Final = 0.02
"""Share of the level points from which on a height has a level surface."""
RISE_M: Final = (0.08, 0.23)
"""Of stairs; fronts of their treads are farther from each other."""
SAME_RISE_M: Final = 0.03
SAME_RISES: Final = 2
"""Least pairs of rises that follow each other and are the same."""
LEVELS: Final = 3
"""Least heights with level surfaces of another axis: the two walls of a passage are none."""
ONE_SIDED: Final = 0.6
"""Least difference of what faces, or lies, up and down, as a share of both."""
CAMERA_M: Final = (0.1, 20.0)
"""Distances ahead at which a depth camera sees."""
DEEP: Final = 1.2
"""Least ratio of the largest and the smallest of these distances."""
CAMERA_SLOPE: Final = (float(np.tan(np.deg2rad(10.0))), float(np.tan(np.deg2rad(65.0))))
"""Least and largest half angle of its view."""
AXES: Final = np.eye(3)
Areas = Float[np.ndarray, "m 3"]


@dataclass(frozen=True)
class UpReading:
    """The axis that points up, and whether another one may, so that it should be looked at."""

    axis: UpAxis
    doubtful: bool


@dataclass(frozen=True, eq=False)
class _Along:
    """Level points of an axis: their number, at how many heights most are, and the extent of all points.

    ``climbs`` if the heights are those of a flight of stairs.
    """

    count: int
    levels: int
    climbs: bool
    extent_m: float
    is_level: Mask


def find_up_axis(points_m: Points, usual: UpAxis, areas: Areas | None = None) -> UpReading:
    """The axis that points up among the points of a terrain; ``usual``, that of the format, unless another is clear.

    ``areas`` are the areas of the triangles of a mesh, along their normals, by which its sides are known.
    """
    edge_m = 0.01
    while len(points_m) > MAX_POINTS:
        points_m = thin_points(points_m, edge_m)
        edge_m *= 1.4
    if len(points_m) < 50:
        return UpReading(usual, False)
    normals = estimate_normals(points_m, 16)
    along = [_along_axis(points_m, normals, k) for k in range(3)]
    at = "xyz".index(usual[1])
    best = max((k for k in range(3) if k != at), key=lambda k: (along[k].climbs, along[k].count))
    if areas is None and _is_camera(points_m) and not _stands_on(points_m, along[2], 2):
        is_stairs = along[2].climbs and not along[1].climbs
        if not is_stairs and along[1].count > CLIMBED_SHARE * along[2].count:
            return UpReading("-y", False)
    doubtful = along[best].count > along[at].count and not along[at].climbs
    if not (doubtful or along[best].climbs) or not _is_clear(along, at, best):
        return UpReading(usual, doubtful)
    sign = _side_of(points_m, along[best], best, areas)
    names: tuple[tuple[UpAxis, UpAxis], ...] = (("+x", "-x"), ("+y", "-y"), ("+z", "-z"))
    return UpReading(usual, True) if sign == 0.0 else UpReading(names[best][sign < 0.0], False)


def _along_axis(points_m: Points, normals: Points, axis: int) -> _Along:
    is_level = np.abs(normals[:, axis]) > LEVEL
    heights_m = points_m[is_level, axis]
    at = np.floor((heights_m - points_m[:, axis].min()) / BIN_M).astype(int)
    counts = np.bincount(at, minlength=1)
    full = counts > LEAST_LEVEL * max(len(at), 1)
    runs = np.cumsum(full & ~np.append(False, full[:-1])) * full
    levels_m = np.array([heights_m[runs[at] == run].mean() for run in range(1, int(runs.max()) + 1)])
    low, high = np.quantile(points_m[:, axis], [0.005, 0.995])
    climbs = len(at) > CLIMBED_POINTS * len(points_m) and _has_equal_rises(np.diff(levels_m))
    return _Along(len(at), len(levels_m), climbs, float(high - low), is_level)


def _has_equal_rises(rises_m: Series) -> bool:
    """Whether enough heights that follow each other have one rise of stairs."""
    is_rise = (rises_m > RISE_M[0]) & (rises_m < RISE_M[1])
    same = is_rise[1:] & is_rise[:-1] & (np.abs(np.diff(rises_m)) < SAME_RISE_M)
    longest = length = 0
    for one in same:
        length = length + 1 if one else 0
        longest = max(longest, length)
    return longest >= SAME_RISES


def _is_camera(points_m: Points) -> bool:
    """Whether the points are in the view of a camera at the origin that looks along z, as depth cameras have it."""
    z = points_m[:, 2]
    if z.min() < CAMERA_M[0] or z.max() > CAMERA_M[1] or z.max() < DEEP * z.min():
        return False
    widest = np.quantile(np.abs(points_m[:, :2]) / z[:, None], 0.995, axis=0)
    return bool((widest < CAMERA_SLOPE[1]).all() and (widest > CAMERA_SLOPE[0]).all())


def _stands_on(points_m: Points, along: _Along, axis: int) -> bool:
    """Whether most of what is level with an axis is the lowest of all, as a floor is and what a camera faces is not."""
    lowest_m = float(np.quantile(points_m[:, axis], 0.005))
    return _ground_of(points_m[along.is_level, axis]) - lowest_m < 2.0 * BIN_M


def _ground_of(heights_m: Series) -> float:
    """The height at which most points are; infinite without any."""
    if len(heights_m) == 0:
        return np.inf
    at = np.floor((heights_m - heights_m.min()) / BIN_M).astype(int)
    return float(np.median(heights_m[np.abs(at - int(np.argmax(np.bincount(at)))) <= 1]))


def _is_clear(along: list[_Along], usual: int, other: int) -> bool:
    """Whether another axis with more level area points up, and not to the walls of a passage."""
    if along[other].levels > 1 and along[usual].count < LEAST_SHARE * along[other].count:
        return True  # one height alone may be that of a wall
    if along[other].climbs and not along[usual].climbs and along[other].count > CLIMBED_SHARE * along[usual].count:
        return True
    third = ({0, 1, 2} - {usual, other}).pop()
    is_tower = along[usual].extent_m > TOWER * max(along[third].extent_m, along[other].extent_m)
    return is_tower and along[other].levels >= LEVELS


def _side_of(points_m: Points, along: _Along, axis: int, areas: Areas | None) -> float:
    """Sign of the direction up along an axis: that to which faces look, or in which things stand; 0 if not known."""
    if areas is not None:
        lengths = np.linalg.norm(areas, axis=1)
        faces = areas[np.abs(areas[:, axis]) > LEVEL * np.maximum(lengths, 1e-12), axis]
        total = float(np.abs(faces).sum())
        if total > 0.0 and abs(float(faces.sum())) > ONE_SIDED * total:
            return float(np.sign(faces.sum()))
    away_m = points_m[:, axis] - _ground_of(points_m[along.is_level, axis])
    above, below = int((away_m > BIN_M).sum()), int((away_m < -BIN_M).sum())
    return float(np.sign(above - below)) if abs(above - below) > ONE_SIDED * max(above + below, 1) else 0.0


def turn_up(points_m: Points, usual: UpAxis, axis: UpAxis) -> Points:
    """Points that were read with ``usual`` up, with another axis of the file up."""
    return np.asarray(points_m @ UP_AXES[usual] @ UP_AXES[axis].T)
