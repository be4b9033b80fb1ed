"""Rails: long thin bars at the height of a hand above treads or floor.

Of clean meshes and scenes, parts that are a long bar are tested. Of scans, lines are fitted to the points that belong
to no plane, and circles across them. Posts, which are upright, are no rails.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from jaxtyping import Float
from scipy.optimize import least_squares
from scipy.spatial import cKDTree

from stridelab.contacts.scenarios.parts import round_values
from stridelab.contacts.terrain_meshes.samples import Samples
from stridelab.contacts.terrain_meshes.shapes import Bar
from stridelab.contacts.terrain_meshes.surfaces import upper_faces
from stridelab.conventions import Mask, Points, Series

RADIUS_M: Final = (0.01, 0.03)
RADIUS_ERROR_M: Final = 2e-3
"""How far beyond it a fitted radius may be."""
HEIGHT_M: Final = (0.6, 1.2)
"""Of a rail's axis above the highest surface below it and beside it."""
BESIDE_M: Final = 0.5
EQUALLY_M: Final = 0.03
SHORTEST_M: Final = 0.4
STEEPEST_RISE: Final = float(np.sin(np.deg2rad(50.0)))
LINEAR: Final = 0.85
"""Least share of the spread of points near each other along their line."""
NEAR_M: Final = 0.15
REACH_M: Final = 0.035
"""Distance from the axis of points of a bar."""
GAP_M: Final = 0.15
FILLED: Final = 0.6
LONELY_RING_M: Final = 0.09
MAX_RAILS: Final = 20
MAX_TRIES: Final = 400


@dataclass(frozen=True, eq=False)
class _Line:
    """Points of a line: a place on it, its direction, and which points belong to it."""

    middle_m: Float[np.ndarray, "3"]
    direction: Float[np.ndarray, "3"]
    members: Mask


def heights_above_surfaces(boxes: Sequence[dict[str, Any]], points_m: Points) -> Series:
    """How far each point is above the upper face nearest to it in plan, at most ``BESIDE_M`` aside; inf without one.

    Of faces equally near, the highest below the point counts.
    """
    heights_m, nearest_m = np.full(len(points_m), np.inf), np.full(len(points_m), BESIDE_M)
    for is_last in (False, True):
        for R, top_m, half_m in upper_faces(boxes):
            local = (points_m - top_m) @ R
            on_face = np.clip(local[:, :2], -half_m, half_m)
            aside_m = np.linalg.norm(local[:, :2] - on_face, axis=1)
            above_m = points_m[:, 2] - (top_m[2] + on_face @ R[2, :2])
            if is_last:
                is_below = (above_m > 0.0) & (aside_m <= nearest_m + EQUALLY_M)
                heights_m = np.where(is_below, np.minimum(heights_m, above_m), heights_m)
            else:
                nearest_m = np.where(above_m > 0.0, np.minimum(nearest_m, aside_m), nearest_m)
    return np.asarray(np.where(nearest_m < BESIDE_M, heights_m, np.inf))


def is_rail(bar: Bar, boxes: Sequence[dict[str, Any]]) -> bool:
    """Whether a bar has the thickness, the length, the slope and the height of a rail."""
    span = bar.to_m - bar.from_m
    length_m = float(np.linalg.norm(span))
    thin, thick = RADIUS_M[0] - RADIUS_ERROR_M, RADIUS_M[1] + RADIUS_ERROR_M
    if length_m < SHORTEST_M or not thin <= bar.radius_m <= thick or abs(span[2]) > STEEPEST_RISE * length_m:
        return False
    places = bar.from_m + np.linspace(0.1, 0.9, 9)[:, None] * span
    height_m = float(np.median(heights_above_surfaces(boxes, places)))
    return HEIGHT_M[0] <= height_m <= HEIGHT_M[1]


def fit_rails(samples: Samples, left: Mask, boxes: Sequence[dict[str, Any]]) -> list[Bar]:
    """Rails among the points that belong to no plane."""
    points_m = samples.points_m[left]
    if len(points_m) < 10:
        return []
    heights_m = heights_above_surfaces(boxes, points_m)
    near = np.isfinite(heights_m) & (heights_m > HEIGHT_M[0] - 0.1) & (heights_m < HEIGHT_M[1] + 0.1)
    candidates = points_m[near]
    rails: list[Bar] = []
    free = np.ones(len(candidates), dtype=bool)
    for seed, direction in _linear_seeds(candidates):
        if len(rails) >= MAX_RAILS:
            break
        if not free[seed]:
            continue
        line = _grow_line(candidates, free, seed, direction, samples)
        bar = None if line is None else _bar_of_line(candidates, line, points_m, samples)
        if line is not None and bar is not None and is_rail(bar, boxes):
            rails.append(bar)
            free &= _line_distances(candidates, line.middle_m, line.direction)[1] > 2.0 * REACH_M
    return rails


def _linear_seeds(points_m: Points) -> Iterator[tuple[int, Float[np.ndarray, "3"]]]:
    """Points whose surroundings are a line that is not upright, with its direction, from the most linear on."""
    if len(points_m) < 10:
        return
    tree = cKDTree(points_m)
    seeds = []
    step = max(len(points_m) // 3_000, 1)
    for seed in range(0, len(points_m), step):
        local = points_m[tree.query_ball_point(points_m[seed], NEAR_M)]
        if len(local) < 5:
            continue
        values, vectors = np.linalg.eigh(np.cov(local.T))
        d = vectors[:, 2]
        share = 1.0 - float(np.sqrt(max(values[1], 0.0) / max(values[2], 1e-12)))
        if share > 1.0 - np.sqrt(1.0 - LINEAR) and abs(d[2]) < STEEPEST_RISE:
            seeds.append((share, seed, d))
    seeds.sort(key=lambda one: -one[0])
    yield from ((seed, d) for _, seed, d in seeds[:MAX_TRIES])


def _line_distances(
    points_m: Points, middle: Float[np.ndarray, "3"], direction: Float[np.ndarray, "3"]
) -> tuple[Series, Series]:
    """Positions along a line, and distances from it."""
    along_m = (points_m - middle) @ direction
    return along_m, np.linalg.norm(points_m - middle - np.outer(along_m, direction), axis=1)


def _grow_line(
    points_m: Points, free: Mask, seed: int, direction: Float[np.ndarray, "3"], samples: Samples
) -> _Line | None:
    """The line through a seed, with the points that follow each other without a large gap."""
    middle, reach_m = points_m[seed], REACH_M + 2.0 * samples.noise_m
    gap_m = max(GAP_M, 4.0 * samples.spacing_m)
    for window_m in (0.2, 0.4, 0.8, 1.6, np.inf, np.inf, np.inf):
        along_m, away_m = _line_distances(points_m, middle, direction)
        near = np.flatnonzero(free & (away_m < reach_m) & (np.abs(along_m) < window_m))
        if len(near) < 8:
            return None
        order = near[np.argsort(along_m[near])]
        breaks = np.flatnonzero(np.diff(along_m[order]) > gap_m)
        piece = int(np.searchsorted(along_m[order][breaks], 0.0)) if len(breaks) else 0
        chosen = np.split(order, breaks + 1)[piece]
        if len(chosen) < 8:
            return None
        members = np.zeros(len(points_m), dtype=bool)
        members[chosen] = True
        middle = points_m[chosen].mean(axis=0)
        d = np.linalg.eigh(np.cov(points_m[chosen].T))[1][:, 2]
        direction = d if d @ direction > 0.0 else -d
    return _Line(middle, direction, members)


def _bar_of_line(points_m: Points, line: _Line, others_m: Float[np.ndarray, "k 3"], samples: Samples) -> Bar | None:
    """The bar of a line's points: a circle across it. None if they leave gaps, or are the edge of something wider."""
    d = line.direction
    along_m, _ = _line_distances(points_m[line.members], line.middle_m, d)
    low, high = float(along_m.min()), float(along_m.max())
    bins = np.floor((along_m - low) / max(2.0 * samples.spacing_m, 0.05)).astype(int)
    if high - low < SHORTEST_M or len(np.unique(bins)) < FILLED * (bins.max() + 1):
        return None
    u = np.cross(d, [0.0, 0.0, 1.0])
    u /= np.linalg.norm(u)
    across = (points_m[line.members] - line.middle_m) @ np.column_stack([u, np.cross(u, d)])
    fit = least_squares(
        lambda x: np.hypot(across[:, 0] - x[0], across[:, 1] - x[1]) - x[2],
        [*across.mean(axis=0), 0.02],
        bounds=([-0.06, -0.06, 4e-3], [0.06, 0.06, 0.06]),
        loss="soft_l1",
        f_scale=max(2.0 * samples.noise_m, 1e-3),
    )
    middle = line.middle_m + fit.x[0] * u + fit.x[1] * np.cross(u, d)
    radius_m = float(fit.x[2])
    other_along, other_away = _line_distances(others_m, middle, d)
    inside = (other_along > low) & (other_along < high)
    ring = inside & (other_away > radius_m + 0.02 + 2.0 * samples.noise_m) & (other_away < LONELY_RING_M)
    if ring.sum() > 0.6 * line.members.sum():
        return None
    from_m, to_m = middle + (low - 0.5 * samples.spacing_m) * d, middle + (high + 0.5 * samples.spacing_m) * d
    return Bar(from_m, to_m, radius_m)


def rail_surfaces(rails: Sequence[Bar]) -> list[dict[str, Any]]:
    """Rails of a scenario's terrain (``RailSurface``), each from its lower end, or from that with the smaller x."""
    surfaces = []
    for k, rail in enumerate(rails):
        level = abs(rail.from_m[2] - rail.to_m[2]) < 0.05
        turned = rail.from_m[0] > rail.to_m[0] if level else rail.from_m[2] > rail.to_m[2]
        ends = (rail.to_m, rail.from_m) if turned else (rail.from_m, rail.to_m)
        surfaces.append(
            {
                "name": f"rail {k + 1}",
                "kind": "rail",
                "from_m": round_values(ends[0].tolist()),
                "to_m": round_values(ends[1].tolist()),
                "radius_m": round(rail.radius_m, 6),
            }
        )
    return surfaces
