"""A second walk over the first: its body, centre of mass and balance, aligned in time and place at a strike.

Both walks are recordings of one result. The same foot strikes at the same instant at the same place, and both walk in
the same direction; from there on they differ as the person walked.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from stridelab_web.parquet import Columns, xyz_columns
from stridelab_web.scene import com_frames, stability_frames
from stridelab_web.scene.frames import Frames, Point, Stick, Track
from stridelab_web.scene.recording_frames import LINES, SKELETON

OTHER: Final = "/other"
"""Beginning of the names of all nodes of the second walk; the rest is the name of the same node of the first."""
STICKS: Final = (SKELETON, LINES, stability_frames.BASE, stability_frames.INSIDE, stability_frames.OUTSIDE)
POINTS: Final = (com_frames.FUSED, stability_frames.XCOM)
TRACKS: Final = (com_frames.PATH, stability_frames.XCOM_PATH)
FLAT_S: Final = 0.1
"""Time after the strike at which the places of the feet are compared: the heel has landed."""
LEAST_WAY_M: Final = 0.3
"""Shortest way from which the walking direction is taken; on a treadmill both directions are that of the belt."""


@dataclass(frozen=True)
class Alignment:
    """``later_s`` is added to times of the second walk; positions x of it become ``R x + t_m``."""

    later_s: float
    R: np.ndarray
    t_m: np.ndarray


def align_at_strike(first: Columns, second: Columns) -> Alignment | None:
    """Alignment of two walks by their rows of ``stability.parquet``; None if no foot strikes in both."""
    pairs = []
    for side in stability_frames.SIDES:
        strikes = [_first_strike(table, side) for table in (first, second)]
        if strikes[0] is not None and strikes[1] is not None:
            pairs.append((strikes[0], strikes[1], side))
    if not pairs:
        return None
    at, other_at, side = min(pairs)
    R = _rotation_between(_direction_of(second), _direction_of(first))
    t_m = _foot_place_m(first, side, at) - R @ _foot_place_m(second, side, other_at)
    return Alignment(float(first["time_s"][at] - second["time_s"][other_at]), R, t_m)


def add_second_walk(frames: Frames, second: Frames, alignment: Alignment) -> Frames:
    """``frames`` with the body, centre of mass, base of support and margins of ``second``, as nodes below ``OTHER``."""
    blocks: list[np.ndarray] = []
    place: dict[int, int] = {}

    def aligned_column(at: int) -> int:
        if at not in place:
            place[at] = frames.values.shape[1] + 3 * len(blocks)
            positions = second.values[:, at : at + 3].astype(float) @ alignment.R.T + alignment.t_m
            blocks.append(_resample(frames.time_s - alignment.later_s, second.time_s, positions))
        return place[at]

    sticks = [
        Stick(OTHER + stick.name, aligned_column(stick.start), aligned_column(stick.end))
        for stick in second.sticks
        if stick.name.startswith(STICKS)
    ]
    points = [
        Point(OTHER + point.name, aligned_column(point.at), f"{point.label}, other walk")
        for point in second.points
        if point.name in POINTS
    ]
    tracks = [Track(OTHER + track.name, aligned_column(track.at)) for track in second.tracks if track.name in TRACKS]
    return replace(
        frames,
        values=np.concatenate([frames.values, *blocks], axis=1, dtype=np.float32),
        sticks=(*frames.sticks, *sticks),
        points=(*frames.points, *points),
        tracks=(*frames.tracks, *tracks),
    )


def next_recording(recording_ids: Sequence[str], shown: str) -> str | None:
    """The recording after ``shown`` in a result, the first one after the last; None if there is no other."""
    others = [one for one in dict.fromkeys(recording_ids) if one != shown]
    if shown not in recording_ids or not others:
        return None
    ordered = list(dict.fromkeys(recording_ids))
    return ordered[(ordered.index(shown) + 1) % len(ordered)]


def _first_strike(table: Columns, side: str) -> int | None:
    """First row in which the foot stands after it did not."""
    stands = np.isfinite(table[f"{side}_outline0_x_m"])
    strikes = np.flatnonzero(stands[1:] & ~stands[:-1]) + 1
    return int(strikes[0]) if len(strikes) else None


def _foot_place_m(table: Columns, side: str, at: int) -> np.ndarray:
    """Middle of the foot's outline shortly after the strike in row ``at``."""
    later = at + int(np.searchsorted(table["time_s"][at:], table["time_s"][at] + FLAT_S))
    corners = [xyz_columns(table, f"{side}_outline{k}_", "_m") for k in range(stability_frames.OUTLINE_POINTS)]
    outline_m = np.mean([corner for corner in corners if corner is not None], axis=0)
    flat = outline_m[min(later, len(outline_m) - 1)]
    return np.asarray(flat if np.isfinite(flat).all() else outline_m[at])


def _direction_of(table: Columns) -> np.ndarray | None:
    """Horizontal direction of the walk; None if it stays in place."""
    com_m = xyz_columns(table, "", "_m")
    if com_m is None:
        return None
    way_m = (com_m[-1] - com_m[0])[:2]
    length_m = float(np.linalg.norm(way_m))
    return way_m / length_m if length_m > LEAST_WAY_M else None


def _rotation_between(direction: np.ndarray | None, target: np.ndarray | None) -> np.ndarray:
    """Rotation about the vertical that turns ``direction`` to ``target``; none if one of them is unknown."""
    R = np.eye(3)
    if direction is not None and target is not None:
        cos = float(direction @ target)
        sin = float(direction[0] * target[1] - direction[1] * target[0])
        R[:2, :2] = [[cos, -sin], [sin, cos]]
    return R


def _resample(time_s: np.ndarray, own_time_s: np.ndarray, positions: np.ndarray) -> np.ndarray:
    columns = [np.interp(time_s, own_time_s, column, left=np.nan, right=np.nan) for column in positions.T]
    return np.column_stack(columns)
