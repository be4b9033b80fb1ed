"""Planes of scanned terrains: regions grown from flat places, fitted, and separated where they meet.

A region begins where a local plane is thin. Points within three times the noise of its plane that are connected to it
join it, and the plane is fitted again, until it grows no further. Regions that are curved more than a sole follows, or
thicker than the noise explains, are none. At last each point belongs to the nearest plane, so that ramps and floors
meet where their planes do.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy import ndimage
from scipy.spatial import cKDTree

from stridelab.contacts.terrain_meshes.planes import (
    CELL_M,
    MAX_CELLS,
    SHORTEST_EDGE_M,
    STEEPEST_RAD,
    Plane,
    axes_along,
)
from stridelab.contacts.terrain_meshes.rectangles import Cells
from stridelab.contacts.terrain_meshes.samples import Samples, fit_plane
from stridelab.conventions import Mask, Points, Rotation, Series

THICKNESS_M: Final = (2e-3, 0.025)
"""Least and largest distance from its plane of a point of a region; between them three times the noise."""
NOISES: Final = 3.0
SEED_M: Final = 0.1
"""One seed in every cube of this size."""
LOCAL_M: Final = 0.12
LOCAL_SHARE: Final = 0.35
"""Least share of a disc of ``LOCAL_M`` that must be filled about a seed."""
MAX_REGIONS: Final = 400
MAX_FITS: Final = 12
CURVED_PER_M: Final = 0.3
"""Curvature from which on a sole does not follow a surface: 1.5 mm over 20 cm."""
SIGNIFICANT: Final = 4.0
INNER_RAD: Final = float(np.deg2rad(15.0))
LEVEL_RAD: Final = float(np.deg2rad(0.5))
YAW_RAD: Final = float(np.deg2rad(3.0))
"""Rectangles that are turned by less against most of the area are turned as it."""
FULL_SHARE: Final = 0.85
"""Share of its bounding rectangle from which on a region has the direction of that rectangle."""

ENCLOSED_M: Final = 0.3
"""Width of a hole within a scanned surface up to which it is one of the scan, if nothing is seen below."""
UP: Final = np.array([0.0, 0.0, 1.0])
Numbers = Int[np.ndarray, "k"]


@dataclass(frozen=True, eq=False)
class Region:
    """Points of a plane, by their numbers, and the plane."""

    middle_m: Float[np.ndarray, "3"]
    normal: Float[np.ndarray, "3"]
    members: Mask

    def distances_of(self, points_m: Points) -> Series:
        """Distances from the plane, positive above it."""
        return np.asarray((points_m - self.middle_m) @ self.normal)


def thickness_of(samples: Samples) -> float:
    """Distance from its plane up to which a point belongs to a region."""
    return float(np.clip(NOISES * samples.noise_m, *THICKNESS_M))


def grow_regions(samples: Samples) -> list[Region]:
    """Flat regions of the samples, of any slope."""
    thickness_m = thickness_of(samples)
    tree = cKDTree(samples.points_m)
    local_m = max(LOCAL_M, 2.5 * samples.spacing_m)
    left = np.ones(len(samples.points_m), dtype=bool)
    regions: list[Region] = []
    for seed in _seeds_of(samples):
        if not left[seed] or len(regions) >= MAX_REGIONS:
            continue
        local = np.array(tree.query_ball_point(samples.points_m[seed], local_m))
        region = _grow_region(samples, seed, local[left[local]], left, local_m)
        if region is not None:
            regions.append(region)
            left &= ~region.members
    return _assign_nearest(samples, regions, thickness_m)


def _seeds_of(samples: Samples) -> Iterator[int]:
    """The flattest point of every cube, from the flattest on."""
    flat = np.flatnonzero(samples.roughness_m < 1.5 * samples.noise_m + 5e-4)
    order = flat[np.argsort(samples.roughness_m[flat])]
    cubes = np.floor(samples.points_m[order] / SEED_M).astype(np.int64)
    _, first = np.unique(cubes, axis=0, return_index=True)
    yield from (int(one) for one in order[np.sort(first)])


def _grow_region(samples: Samples, seed: int, local: Numbers, left: Mask, local_m: float) -> Region | None:
    """The region of a seed; None if it is too small, curved or thick."""
    middle, n, thickness_m = samples.points_m[seed], samples.normals[seed], thickness_of(samples)
    for _ in range(4):
        near = local[np.abs((samples.points_m[local] - middle) @ n) < 1.5 * thickness_m]
        if len(near) * samples.spacing_m**2 < LOCAL_SHARE * np.pi * local_m**2:
            return None
        middle, n = fit_plane(samples.points_m[near])
    region, size = Region(middle, n, np.zeros(len(left), dtype=bool)), 0
    for _ in range(MAX_FITS):
        candidates = np.flatnonzero(left & (np.abs(region.distances_of(samples.points_m)) < thickness_m))
        members = candidates[_connected_part(samples, region, candidates, samples.points_m[seed])]
        if len(members) < 12:
            return None
        middle, n = fit_plane(samples.points_m[_inner_members(samples, members, region.normal)])
        chosen = np.zeros(len(left), dtype=bool)
        chosen[members] = True
        region = Region(middle, n, chosen)
        if abs(len(members) - size) < 0.005 * size:
            break
        size = len(members)
    return region if _is_flat(samples, region) else None


def _connected_part(
    samples: Samples, region: Region, at: Numbers, seed_m: Float[np.ndarray, "3"]
) -> Bool[np.ndarray, "k"]:
    """Which points are connected to a seed on a grid in the plane."""
    R = axes_along(np.cross(region.normal, _axis_aside(region.normal)), region.normal)
    flat = samples.points_m[at] @ R[:, :2]
    cell_m = max(CELL_M, 2.0 * samples.spacing_m)
    cells = np.floor((flat - flat.min(axis=0, initial=np.inf)) / cell_m).astype(int)
    if len(cells) == 0 or np.prod(cells.max(axis=0) + 1.0) > 4e6:
        return np.zeros(len(at), dtype=bool)
    grid = np.zeros(tuple(cells.max(axis=0) + 1), dtype=bool)
    grid[tuple(cells.T)] = True
    labels = ndimage.label(grid, structure=np.ones((3, 3)))[0]
    here = labels[tuple(cells.T)]
    return np.asarray(here == here[int(np.argmin(np.linalg.norm(flat - seed_m @ R[:, :2], axis=1)))])


def _axis_aside(normal: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3"]:
    return np.array([0.0, 1.0, 0.0]) if abs(normal[1]) < 0.9 else np.array([1.0, 0.0, 0.0])


def _inner_members(samples: Samples, members: Numbers, normal: Float[np.ndarray, "3"]) -> Int[np.ndarray, "k_inner"]:
    """Members whose local planes have about the normal of the region, if most have; others are at risers and edges."""
    along = np.abs(samples.normals[members] @ normal) > np.cos(INNER_RAD)
    return members[along] if along.sum() > 0.5 * len(members) else members


def _is_flat(samples: Samples, region: Region) -> bool:
    """Whether a region has the size of a sole, and is neither curved nor thicker than the noise explains."""
    members = np.flatnonzero(region.members)
    if len(members) * samples.spacing_m**2 < SHORTEST_EDGE_M**2:
        return False
    points_m = samples.points_m[_inner_members(samples, members, region.normal)]
    R = axes_along(np.cross(region.normal, _axis_aside(region.normal)), region.normal)
    local = (points_m - region.middle_m) @ R
    u, v, z = local.T
    if float(np.sqrt(np.mean(z * z))) > 1.5 * samples.noise_m + 1e-3:
        return False
    scale = max(float(np.abs(local[:, :2]).max()), 1e-6)
    u, v = u / scale, v / scale
    columns = np.column_stack([np.ones_like(u), u, v, u * u, u * v, v * v])
    inverse = np.linalg.pinv(columns.T @ columns)
    values = inverse @ columns.T @ z
    residual_m = float(np.std(z - columns @ values))
    a, b, c = values[3:] / scale**2
    curvature = float(np.abs(np.linalg.eigvalsh([[2 * a, b], [b, 2 * c]])).max())
    error = 2.0 * residual_m * float(np.sqrt(np.diag(inverse)[3:].max())) / scale**2
    return curvature < CURVED_PER_M or curvature < SIGNIFICANT * error


def _assign_nearest(samples: Samples, regions: Sequence[Region], thickness_m: float) -> list[Region]:
    """The regions with each point in the one whose plane is nearest, among those that it is connected to."""
    best_m, owner = np.full(len(samples.points_m), np.inf), np.full(len(samples.points_m), -1)
    reach_m = 2.0 * max(samples.spacing_m, 0.5 * CELL_M) + 2.0 * thickness_m
    for k, region in enumerate(regions):
        away_m = np.abs(region.distances_of(samples.points_m))
        near = np.flatnonzero(away_m < thickness_m)
        tree = cKDTree(samples.points_m[region.members])
        apart_m = tree.query(samples.points_m[near], distance_upper_bound=4.0 * reach_m)[0]
        near = near[(apart_m < 4.0 * reach_m) & (away_m[near] < best_m[near])]
        best_m[near], owner[near] = away_m[near], k
    fitted = []
    for k, region in enumerate(regions):
        members = owner == k
        if members.sum() * samples.spacing_m**2 >= 0.5 * SHORTEST_EDGE_M**2 and members.sum() >= 12:
            inner = _inner_members(samples, np.flatnonzero(members), region.normal)
            middle, n = fit_plane(samples.points_m[inner])
            fitted.append(
                replace(region, middle_m=middle, normal=_level_normal(samples, middle, n, members), members=members)
            )
    return fitted


def _level_normal(
    samples: Samples, middle: Float[np.ndarray, "3"], n: Float[np.ndarray, "3"], members: Mask
) -> Float[np.ndarray, "3"]:
    """The normal, upright if the plane is level within the error of its fit."""
    local = samples.points_m[members] - middle
    spread_m = float(np.sqrt(np.sort(np.linalg.eigvalsh(local.T @ local / len(local)))[1]))
    error_rad = 3.0 * samples.noise_m / (max(spread_m, 1e-3) * np.sqrt(len(local)))
    tilt_rad = float(np.arccos(min(n[2], 1.0)))
    return np.array([0.0, 0.0, 1.0]) if tilt_rad < max(LEVEL_RAD, error_rad) else n


def scanned_planes(samples: Samples, regions: Sequence[Region]) -> list[Plane]:
    """The planes of regions at most ``STEEPEST_RAD`` steep, with axes along their rectangles."""
    standing = [one for one in regions if one.normal[2] > np.cos(STEEPEST_RAD)]
    measured = []
    for region in standing:
        R = axes_along(np.cross(region.normal, _axis_aside(region.normal)), region.normal)
        flat = samples.points_m[region.members] @ R[:, :2]
        turn_rad, area_m2 = _smallest_bounds(flat)
        turn_rad += _turn_of_edges(flat, turn_rad, samples.spacing_m)
        is_full = len(flat) * samples.spacing_m**2 > FULL_SHARE * area_m2
        yaw_rad = float(np.arctan2(R[1, 0], R[0, 0])) + turn_rad
        measured.append((R, turn_rad, yaw_rad, area_m2 if is_full else 0.0))
    common_rad = _common_yaw([(yaw_rad, weight) for _, _, yaw_rad, weight in measured])
    planes = []
    for region, (R, turn_rad, yaw_rad, weight) in zip(standing, measured, strict=True):
        if common_rad is not None:
            apart_rad = (common_rad - yaw_rad + 0.25 * np.pi) % (0.5 * np.pi) - 0.25 * np.pi
            turn_rad += apart_rad if abs(apart_rad) < YAW_RAD or weight == 0.0 else 0.0
        along = R[:, 0] * np.cos(turn_rad) + R[:, 1] * np.sin(turn_rad)
        planes.append(_plane_of_region(samples, region, axes_along(along, region.normal)))
    return planes


def _smallest_bounds(flat: Float[np.ndarray, "n 2"]) -> tuple[float, float]:
    """The turn (rad) of the smallest rectangle that bounds all but a hundredth of the points on each side; its area."""

    def area_of(turn_rad: float) -> float:
        c, s = np.cos(turn_rad), np.sin(turn_rad)
        turned = flat @ np.array([[c, -s], [s, c]])
        low, high = np.quantile(turned, [0.01, 0.99], axis=0)
        return float(np.prod((high - low) / 0.98))

    turns = np.deg2rad(np.arange(0.0, 90.0, 3.0))
    if len(flat) > 20_000:
        flat = flat[:: len(flat) // 20_000 + 1]
    best = float(turns[int(np.argmin([area_of(float(one)) for one in turns]))])
    for step_deg in (1.0, 0.3, 0.1):
        around = best + np.deg2rad(step_deg * np.arange(-3.0, 4.0))
        best = float(around[int(np.argmin([area_of(float(one)) for one in around]))])
    return best, area_of(best)


def _turn_of_edges(flat: Float[np.ndarray, "n 2"], turn_rad: float, spacing_m: float) -> float:
    """How much further (rad) the edges of a rectangle are turned: lines through the outermost points of strips.

    Longer edges count more, by the third power of their length, as the errors of their lines do.
    """
    c, s = np.cos(turn_rad), np.sin(turn_rad)
    turned = flat @ np.array([[c, -s], [s, c]])
    low, high = np.quantile(turned, [0.01, 0.99], axis=0)
    total, weights = 0.0, 0.0
    for axis, sign in ((0, 1.0), (1, -1.0)):
        along = turned[:, axis]
        inner = (along > low[axis]) & (along < high[axis])
        strips = np.floor((along[inner] - low[axis]) / (2.0 * spacing_m)).astype(int)
        if len(strips) == 0 or strips.max() < 3:
            continue
        for side in (-1.0, 1.0):
            outermost = np.full(int(strips.max()) + 1, -np.inf)
            np.maximum.at(outermost, strips, side * turned[inner, 1 - axis])
            at = np.flatnonzero(np.isfinite(outermost))
            near = np.abs(outermost[at] - np.median(outermost[at])) < 2.0 * spacing_m
            if near.sum() >= 4:
                slope = side * float(np.polyfit(2.0 * spacing_m * at[near], outermost[at[near]], 1)[0])
                weight = float(high[axis] - low[axis]) ** 3
                total, weights = total + sign * weight * np.arctan(slope), weights + weight
    return total / weights if weights and abs(total) < YAW_RAD * weights else 0.0


def _common_yaw(yaws: Sequence[tuple[float, float]]) -> float | None:
    """The direction (modulo a quarter turn) with the most area within ``YAW_RAD``."""
    angles, weights = (np.array(values) for values in zip(*yaws, strict=True)) if yaws else (np.zeros(0), np.zeros(0))
    if not weights.any():
        return None
    apart = (angles[:, None] - angles + 0.25 * np.pi) % (0.5 * np.pi) - 0.25 * np.pi
    near = np.abs(apart) < YAW_RAD
    best = int(np.argmax((near * weights[:, None]).sum(axis=0)))
    return float(angles[best] + np.average(apart[:, best], weights=near[:, best] * weights))


def _plane_of_region(samples: Samples, region: Region, R: Rotation) -> Plane:
    """The plane of a region; covered are cells near its points, and holes as narrow as ``gap_m`` allows."""
    flat = samples.points_m[region.members] @ R[:, :2]
    margin_m = samples.gap_m + 2.0 * CELL_M
    low_m, high_m = flat.min(axis=0) - margin_m, flat.max(axis=0) + margin_m
    cell_m = max(0.5 * CELL_M, float((high_m - low_m).max()) / MAX_CELLS)
    covered = np.zeros(np.ceil((high_m - low_m) / cell_m).astype(int), dtype=bool)
    covered[tuple(np.floor((flat - low_m) / cell_m).astype(int).T)] = True
    offset_m = float(region.middle_m @ region.normal)
    sure = close_holes(covered, 1.5 * samples.spacing_m / cell_m)
    covered = close_holes(covered, samples.gap_m / cell_m)
    below = samples.points_m[region.distances_of(samples.points_m) < -2.0 * thickness_of(samples)]
    above_m, seen = Plane(R, offset_m, flat, low_m, cell_m, covered & ~sure).heights_above(below)
    cells = np.floor((below - np.outer(above_m, UP))[seen] @ R[:, :2] / cell_m - low_m / cell_m).astype(int)
    covered[tuple(cells.T)] = False
    covered = _fill_enclosed(covered, np.floor((below @ R[:, :2] - low_m) / cell_m).astype(int), cell_m)
    return Plane(R, offset_m, flat, low_m, cell_m, covered, samples.spacing_m)


def _fill_enclosed(covered: Cells, seen_below: Int[np.ndarray, "k 2"], cell_m: float) -> Cells:
    """The cells, with enclosed holes of the scan filled up to ``ENCLOSED_M`` wide below which nothing is seen."""
    labels, count = ndimage.label(~covered)
    inside = ((seen_below >= 0) & (seen_below < covered.shape)).all(axis=1)
    open_holes = {0, *labels[tuple(seen_below[inside].T)].tolist()}
    for edge in (labels[0], labels[-1], labels[:, 0], labels[:, -1]):
        open_holes.update(edge.tolist())
    widths = np.asarray(ndimage.distance_transform_edt(~covered)) * 2.0 * cell_m
    filled = covered.copy()
    for hole in set(range(1, count + 1)) - open_holes:
        if widths[labels == hole].max() <= ENCLOSED_M:
            filled |= labels == hole
    return filled


def close_holes(covered: Cells, radius: float) -> Cells:
    """Morphological closing with a disc of a radius in cells."""
    wide = np.asarray(ndimage.distance_transform_edt(~covered)) <= radius
    return np.asarray(ndimage.distance_transform_edt(wide) > radius)
