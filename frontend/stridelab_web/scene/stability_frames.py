"""Measures of gait in the scene: extrapolated centre of mass, base of support, margins of stability, angular momentum.

The base of support is the convex hull of the outlines of the feet that stand, drawn on the floor as its edges: one from
every point of an outline that is a corner to the next corner. A margin is drawn from the extrapolated centre of mass to
the outer edge of the standing foot, in another colour where it is negative.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np

from stridelab_web.parquet import Columns, xyz_columns
from stridelab_web.scene.frames import ARROW_M_PER_N, Arrow, Point, Sheet, Stick, Track, resample_track

XCOM: Final = "/stability/xcom"
XCOM_PATH: Final = "/stability/xcom_path"
BASE: Final = "/stability/base"
INSIDE, OUTSIDE = "/margin/inside_", "/margin/outside_"
MOMENTUM: Final = "/momentum/angular"
MOMENTUM_S_PER_M: Final = 10.0
"""Length of the arrow of the angular momentum in metres, per m^2/s and kilogram of body mass."""
SIDES: Final = ("left", "right")
OUTLINE_POINTS: Final = 5


@dataclass(frozen=True)
class StabilityFrames:
    """Nodes of the measures; their columns are in the given sheet."""

    points: tuple[Point, ...] = ()
    tracks: tuple[Track, ...] = ()
    sticks: tuple[Stick, ...] = ()
    arrows: tuple[Arrow, ...] = ()


def add_stability(sheet: Sheet, time_s: np.ndarray, table: Columns) -> StabilityFrames:
    """Add the rows of ``stability.parquet`` that are of the recording to ``sheet`` at the times ``time_s``."""

    def resampled_track(before: str, after: str = "_m") -> np.ndarray:
        columns = xyz_columns(table, before, after)
        if columns is None:
            return np.full((len(time_s), 3), np.nan)
        return resample_track(time_s, table["time_s"], columns)

    xcom_m = resampled_track("xcom_")
    at = sheet.add_block(xcom_m)
    outline_m = np.stack(
        [resampled_track(f"{side}_outline{k}_") for side in SIDES for k in range(OUTLINE_POINTS)], axis=1
    )
    following = next_corners(outline_m[:, :, :2])
    outline_m[:, :, 2] = xcom_m[:, 2:]
    sticks = []
    for k in range(outline_m.shape[1]):
        is_corner = (following[:, k] >= 0)[:, None]
        ends = outline_m[np.arange(len(time_s)), following[:, k]]
        start, end = (sheet.add_block(np.where(is_corner, points, np.nan)) for points in (outline_m[:, k], ends))
        sticks.append(Stick(f"{BASE}{k}", start, end))
    for side in SIDES:
        margin_m = resample_track(time_s, table["time_s"], table[f"{side}_margin_m"][:, None])
        edge_m = resampled_track(f"{side}_edge_")
        for name, chosen in ((INSIDE, margin_m >= 0.0), (OUTSIDE, margin_m < 0.0)):
            sticks.append(Stick(f"{name}{side}", at, sheet.add_block(np.where(chosen, edge_m, np.nan))))
    com_m, momentum = resampled_track(""), resampled_track("momentum_", "_m2_s")
    arrow_at = sheet.add_block(com_m)
    sheet.add_block(MOMENTUM_S_PER_M / ARROW_M_PER_N * momentum)
    return StabilityFrames(
        points=(Point(XCOM, at, "extrapolated centre of mass"),),
        tracks=(Track(XCOM_PATH, at),),
        sticks=tuple(sticks),
        arrows=(Arrow(f"{MOMENTUM}_shaft", f"{MOMENTUM}_head", arrow_at, "angular momentum"),),
    )


def next_corners(points_m: np.ndarray) -> np.ndarray:
    """Index of the next corner of the convex hull, counter-clockwise, of every point ``(n, k, 2)``; -1 for others.

    Points that are NaN are no corners; fewer than three points have no hull.
    """
    following = np.full(points_m.shape[:2], -1)
    for row, points in enumerate(points_m):
        given = np.flatnonzero(np.isfinite(points).all(axis=1))
        order = given[np.lexsort((points[given, 1], points[given, 0]))]
        if len(order) < 3:
            continue
        corners = [*_chain(points, order)[:-1], *_chain(points, order[::-1])[:-1]]
        following[row, corners] = np.roll(corners, -1)
    return following


def _chain(points: np.ndarray, order: np.ndarray) -> list[int]:
    """Half of a hull (Andrew 1979): the points in ``order`` without those that would turn clockwise."""
    chain: list[int] = []
    for k in order:
        while len(chain) > 1:
            (ax, ay), (bx, by) = points[chain[-1]] - points[chain[-2]], points[k] - points[chain[-2]]
            if ax * by - ay * bx > 0.0:
                break
            chain.pop()
        chain.append(int(k))
    return chain
