"""Frames of an estimate beside those of its recording: centre of mass, its band, and the inputs of section 2.4.1.

Of the three inputs, (i) the geometry and (iii) its projection (2.12) onto the central axis of the contact force are
positions, shown as a point and a path each; (ii) is a force, and the recording's arrows show it. The axis itself is a
line along the force through (iii).
"""

from dataclasses import dataclass
from typing import Final

import numpy as np

from stridelab_web.parquet import Columns, xyz_columns
from stridelab_web.scene.frames import Ellipsoid, Point, Sheet, Stick, Track, resample_track

FUSED, BAND, AXIS = "/com/fused", "/com/band", "/axis/line"
PATH: Final = "/paths/fused"
GEOMETRY, ON_AXIS = "/inputs/geometry", "/inputs/axis"
BAND_WIDTHS: Final = 1.96
"""Semi-axes of the band in standard deviations: 95 % per axis."""
ABOVE_M: Final = 0.6
"""Length of the central axis above the point nearest to the geometry; downwards it ends at the floor."""
MAX_DOWN_M: Final = 2.5


@dataclass(frozen=True)
class ComFrames:
    """Nodes of the centre of mass; their columns are in the given sheet."""

    points: tuple[Point, ...] = ()
    tracks: tuple[Track, ...] = ()
    ellipsoids: tuple[Ellipsoid, ...] = ()
    sticks: tuple[Stick, ...] = ()


def add_com(sheet: Sheet, time_s: np.ndarray, com: Columns, floor_m: float) -> ComFrames:
    """Add the columns of ``com.parquet`` to ``sheet`` at the times ``time_s``; missing columns are left out."""

    def resampled_track(before: str, after: str = "_m") -> np.ndarray | None:
        columns = xyz_columns(com, before, after)
        return None if columns is None else resample_track(time_s, com["time_s"], columns)

    points: list[Point] = []
    tracks: list[Track] = []
    for before, point, path, label in (
        ("geometry_", f"{GEOMETRY}/point", f"{GEOMETRY}/path", "centre of mass, markers only"),
        ("axis_", f"{ON_AXIS}/point", f"{ON_AXIS}/path", "nearest point of the central axis"),
        ("", FUSED, PATH, "centre of mass"),
    ):
        track = resampled_track(before)
        if track is not None:
            at = sheet.add_block(track)
            tracks.append(Track(path, at))
            points.append(Point(point, at, label))
    ellipsoids: list[Ellipsoid] = []
    sd = resampled_track("sd_")
    if sd is not None and points and points[-1].name == FUSED:
        ellipsoids.append(Ellipsoid(BAND, points[-1].at, sheet.add_block(BAND_WIDTHS * sd)))
    sticks: list[Stick] = []
    on_axis, force = resampled_track("axis_"), resampled_track("force_", "_n")
    if on_axis is not None and force is not None:
        low, high = axis_ends(on_axis, force, floor_m)
        sticks.append(Stick(AXIS, sheet.add_block(low), sheet.add_block(high)))
    return ComFrames(tuple(points), tuple(tracks), tuple(ellipsoids), tuple(sticks))


def axis_ends(on_axis_m: np.ndarray, force_n: np.ndarray, floor_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Ends ``(frames, 3)`` of the central axis as it is drawn: from the floor to above the point ``on_axis_m``."""
    direction = force_n / np.linalg.norm(force_n, axis=1, keepdims=True)
    down = (on_axis_m[:, 2:] - floor_m) / np.maximum(direction[:, 2:], 1e-3)
    return on_axis_m - np.clip(down, 0.0, MAX_DOWN_M) * direction, on_axis_m + ABOVE_M * direction
