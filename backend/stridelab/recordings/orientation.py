"""Determines the vertical axis of a file and the direction of walking.

Vector algebra on tracks of points: row i is the vector at frame i; NaN propagates.
"""

from collections.abc import Sequence

import numpy as np

from stridelab.conventions import Points, Rotation, Series, Vector3
from stridelab.recordings.files.raw import Cloud

_AXES = {"+x": (0, 1.0), "-x": (0, -1.0), "+y": (1, 1.0), "-y": (1, -1.0), "+z": (2, 1.0), "-z": (2, -1.0)}
_SNAP_COS = float(np.cos(np.deg2rad(20.0)))
"""Largest angle between the mean force and an axis for the axis to count as vertical."""
_TRAVEL_M = 0.4
"""Minimum travel of overground walking over a whole recording."""


def axis_vector(name: str) -> Vector3:
    """Unit vector of a named axis: ``"+y"`` -> (0, 1, 0)."""
    i, sign = _AXES[name]
    vector = np.zeros(3)
    vector[i] = sign
    return vector


def nearest_axis(vector: Vector3) -> str | None:
    """Name of the axis within 20 degrees of ``vector``, else None."""
    norm = float(np.linalg.norm(vector))
    if not np.isfinite(norm) or norm == 0.0:
        return None
    name = max(_AXES, key=lambda axis: float(axis_vector(axis) @ vector))
    return name if float(axis_vector(name) @ vector) >= _SNAP_COS * norm else None


def rotation_to_z_up(up: str) -> Rotation:
    """Rotation R with R up = +z: the identity for "+z", else by 90 or 180 degrees about one axis."""
    fixed: dict[str, list[list[float]]] = {
        "+z": [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
        "-z": [[1, 0, 0], [0, -1, 0], [0, 0, -1]],
        "+y": [[1, 0, 0], [0, 0, -1], [0, 1, 0]],
        "-y": [[1, 0, 0], [0, 0, 1], [0, -1, 0]],
        "+x": [[0, 0, -1], [0, 1, 0], [1, 0, 0]],
        "-x": [[0, 0, 1], [0, 1, 0], [-1, 0, 0]],
    }
    return np.array(fixed[up], dtype=np.float64)


def find_up_axis(
    vertical: Vector3 | None, plate_centres_m: Sequence[Vector3], points_m: Cloud, hint: str | None
) -> str:
    """Axis of the file that points up.

    The mean total force (the plates' normal if they are unloaded) gives the axis; its sign follows from the markers,
    which lie above the plates. Without plates: the file's hint, else the longest side of the marker cloud in the frame
    with the most markers, from the floor upwards.
    """
    seen = points_m[~np.isnan(points_m).any(axis=2)]
    centre = seen.mean(axis=0) if len(seen) else np.full(3, np.nan)
    axis = None if vertical is None else nearest_axis(vertical)
    if axis is not None:
        above = centre - np.mean(plate_centres_m, axis=0) if plate_centres_m else np.full(3, np.nan)
        height_m = float(axis_vector(axis) @ above)
        if np.isfinite(height_m) and height_m < -0.2:
            return _opposite_axis(axis)
        return axis
    if hint is not None:
        return hint
    if not len(seen):
        return "+z"
    best = int(np.argmax((~np.isnan(points_m[:, :, 0])).sum(axis=1)))
    extent = np.nanmax(points_m[best], axis=0) - np.nanmin(points_m[best], axis=0)
    i = int(np.argmax(extent))
    return ("+" if centre[i] >= 0.0 else "-") + "xyz"[i]


def _opposite_axis(axis: str) -> str:
    return ("-" if axis[0] == "+" else "+") + axis[1]


def travel_m(points_m: Cloud, rate_hz: float) -> Vector3 | None:
    """Displacement of the body over the recording: median of the labels' mean velocities, times the duration.

    None if no label is visible in three frames. Unlike a centroid, the median does not jump at gaps.
    """
    time_s = np.arange(len(points_m)) / rate_hz
    velocities = []
    for track in points_m.transpose(1, 0, 2):
        seen = ~np.isnan(track).any(axis=1)
        if seen.sum() >= 3:
            t = time_s[seen] - time_s[seen].mean()
            velocities.append(t @ track[seen] / (t @ t))
    if not velocities:
        return None
    span_s = len(points_m) / rate_hz
    return np.asarray(np.median(velocities, axis=0) * span_s, dtype=np.float64)


def walking_direction(points_m: Cloud, rate_hz: float) -> Vector3 | None:
    """Horizontal unit vector of travel (z up), or None if the body stays in place (standing, treadmill)."""
    travel = travel_m(points_m, rate_hz)
    if travel is None:
        return None
    horizontal = travel * [1.0, 1.0, 0.0]
    distance_m = float(np.linalg.norm(horizontal))
    return horizontal / distance_m if distance_m >= _TRAVEL_M else None


def belt_direction(feet_m: Sequence[Points], rate_hz: float) -> Vector3 | None:
    """Walking direction on a treadmill: feet swing forward faster than the belt carries them back.

    ``feet_m`` are tracks of low markers. None if they hardly move (standing).
    """
    velocities = [np.diff(track[:, :2], axis=0) * rate_hz for track in feet_m if len(track) > 2]
    v = np.concatenate(velocities) if velocities else np.zeros((0, 2))
    v = v[~np.isnan(v).any(axis=1)]
    if len(v) < 3:
        return None
    _, s, axes = np.linalg.svd(v - v.mean(axis=0), full_matrices=False)
    if s[0] / np.sqrt(len(v)) < 0.3:
        return None
    along = v @ axes[0]
    forward = 1.0 if np.percentile(along, 98) > -np.percentile(along, 2) else -1.0
    return np.array([axes[0, 0], axes[0, 1], 0.0]) * forward


def unit(v: Points) -> Points:
    """Rows scaled to length one; NaN for a row of zeros."""
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(v / np.linalg.norm(v, axis=1, keepdims=True))


def dot(a: Points, b: Points) -> Series:
    """Row-wise scalar product."""
    return np.asarray(np.einsum("ij,ij->i", a, b))


def cross(a: Points, b: Points) -> Points:
    """Row-wise vector product, at a third of the cost of ``np.cross`` for the few frames of a live measurement."""
    a0, a1, a2 = a.T
    b0, b1, b2 = b.T
    product = np.empty(np.broadcast_shapes(a.shape, b.shape))
    product[:, 0] = a1 * b2 - a2 * b1
    product[:, 1] = a2 * b0 - a0 * b2
    product[:, 2] = a0 * b1 - a1 * b0
    return product


def component_along(v: Points, axis: Points) -> Points:
    """Component of ``v`` along the unit vectors ``axis``."""
    return np.asarray(dot(v, axis)[:, None] * axis)


def perpendicular_unit(v: Points, axis: Points) -> Points:
    """Unit vectors of the component of ``v`` perpendicular to the unit vectors ``axis``."""
    return unit(v - component_along(v, axis))


def median_or_nan(values: Series) -> float:
    """Median over the values that are not NaN; NaN without any. Costs a fifth of ``np.nanmedian`` for few values."""
    ordered = np.sort(values[~np.isnan(values)])
    middle = len(ordered) // 2
    if not len(ordered):
        return float("nan")
    return float(ordered[middle]) if len(ordered) % 2 else float((ordered[middle - 1] + ordered[middle]) / 2.0)


def median_distance_m(a: Points, b: Points) -> float:
    """Median distance between two tracks in metres, such as the length of a bone."""
    return median_or_nan(np.linalg.norm(a - b, axis=1))
