"""Checks that the centre of pressure of each plate lies under a standing foot and inside the plate's corners."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from stridelab.conventions import Mask, Points, Series
from stridelab.recordings.files.raw import CONTACT_TYPE
from stridelab.recordings.foot_contact import Foot, find_feet
from stridelab.recordings.force_plates import plate_axes
from stridelab.recordings.plate_contacts import low_pass as low_pass_force
from stridelab.recordings.recording import Plate, Recording

LOADED_N: Final = 100.0
"""Minimum load for an accurate centre of pressure."""
EDGE_M: Final = 0.02
_PRESSURE_MIN_FRAMES = 5


@dataclass(frozen=True)
class PlatePressure:
    """Centre of pressure of plate ``index`` while it is loaded.

    ``from_feet_m`` is the median horizontal distance from the standing feet's markers, NaN if the feet are not marked;
    ``off_plate`` the share of the time outside the corners, NaN for a contact without a plate.
    """

    index: int
    from_feet_m: float
    off_plate: float


def plate_pressures(
    recording: Recording, landmarks: Mapping[str, str], during: Mask, latency_s: float
) -> tuple[PlatePressure, ...]:
    """Evaluate every plate in use that is loaded in the frames ``during``; the force is read ``latency_s`` later."""
    feet = find_feet(recording, landmarks)
    pressures = []
    for plate in recording.plates:
        if not plate.use:
            continue
        pressure_m, loaded = _pressure_at_frames(recording, plate, latency_s)
        loaded &= during
        if np.count_nonzero(loaded) < _PRESSURE_MIN_FRAMES:
            continue
        apart = np.array([_distance_from_feet(feet, pressure_m[i], int(i)) for i in np.flatnonzero(loaded)])
        from_feet_m = float(np.nanmedian(apart)) if np.isfinite(apart).any() else float("nan")
        pressures.append(PlatePressure(plate.index, from_feet_m, _share_off_plate(plate, pressure_m[loaded])))
    return tuple(pressures)


def _pressure_at_frames(recording: Recording, plate: Plate, latency_s: float) -> tuple[Points, Mask]:
    """Centre of pressure on the plate's surface at the marker instants, and the mask of loaded frames."""
    read_at_s = recording.time_s + latency_s
    force_time_s = np.arange(len(plate.force_n)) / recording.force_rate_hz
    f, nu = (
        np.column_stack([np.interp(read_at_s, force_time_s, track[:, j]) for j in range(3)])
        for track in (
            low_pass_force(plate.force_n, recording.force_rate_hz),
            low_pass_force(plate.moment_nm, recording.force_rate_hz),
        )
    )
    c, n = plate.corners_m.mean(axis=0), plate_axes(plate.corners_m)[:, 2]
    normal_n = f @ n
    loaded = np.abs(normal_n) > LOADED_N
    about_centre = nu - np.cross(c, f)
    p = c + np.cross(n, about_centre) / np.where(loaded, normal_n, np.inf)[:, None]
    return p, np.asarray(loaded)


def _distance_from_feet(feet: Sequence[Foot], pressure_m: Series, frame: int) -> float:
    """Horizontal distance from the convex hull of the markers of all feet in contact; NaN without any."""
    standing = [foot.markers_m[frame, :, :2] for foot in feet if foot.contact[frame]]
    hulls = [points[np.isfinite(points).all(axis=1)] for points in standing]
    hulls = [points for points in hulls if len(points)]
    if not hulls:
        return float("nan")
    return min(_distance_from_polygon(pressure_m[:2], points) for points in (*hulls, np.concatenate(hulls)))


def _distance_from_polygon(point: Series, corners: np.ndarray) -> float:
    """Distance of a point from the convex hull of ``corners`` in the plane."""
    ring = corners
    if len(corners) > 2:
        try:
            hull = ConvexHull(corners)
        except QhullError:
            pass
        else:
            if (hull.equations[:, :2] @ point + hull.equations[:, 2]).max() <= 0.0:
                return 0.0
            ring = corners[hull.vertices]
    a, b = ring, np.roll(ring, -1, axis=0)
    along = b - a
    share = np.clip(((point - a) * along).sum(axis=1) / np.maximum((along**2).sum(axis=1), 1e-12), 0.0, 1.0)
    return float(np.linalg.norm(a + share[:, None] * along - point, axis=1).min())


def _share_off_plate(plate: Plate, pressure_m: Points) -> float:
    if plate.type == CONTACT_TYPE:
        return float("nan")
    corners = plate.corners_m
    local = (pressure_m - corners.mean(axis=0)) @ plate_axes(corners)
    half_x = 0.5 * np.linalg.norm(corners[0] - corners[1]) + EDGE_M
    half_y = 0.5 * np.linalg.norm(corners[0] - corners[3]) + EDGE_M
    return float(np.mean((np.abs(local[:, 0]) > half_x) | (np.abs(local[:, 1]) > half_y)))
