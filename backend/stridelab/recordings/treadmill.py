"""Treadmills: detection, the speed of each belt, and the velocity of the surface under each foot.

A belt's speed is stated by the user, or estimated from the standing feet: the median velocity of the foot markers while
they are low. The two belts of a split-belt treadmill may differ; each foot then has the belt that it stands on.
"""

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from stridelab.conventions import Points, Vector3
from stridelab.errors import Fault, InvalidInput
from stridelab.recordings import orientation
from stridelab.recordings.files.raw import Cloud
from stridelab.recordings.recording import Plate, Recording, Remark, Side

TREADMILL: Final = "treadmill"
"""Code of the remark on a recording that was made on a treadmill."""
SPLIT_SHARE: Final = 0.15
"""Relative difference of the feet's surfaces from which on the belts are taken for different."""
BELT_TOLERANCE: Final = 0.25
"""Relative difference between a stated belt speed and that of the feet; running feet are up to 10 % too slow."""
_BELT_TOLERANCE_M_S: Final = 0.1
_HALF_SPAN_S: Final = 0.01
_FEET_MARKERS: Final = 4
_DRIFT_SHARE: Final = 0.25
"""A body that travels slower than this share of the belt's speed drifts on a treadmill."""
_MIN_BELT_M_S: Final = 0.3
_STOPPED_M_S: Final = 0.05


def detect_treadmill(
    tracks: Sequence[Points], plates: Sequence[Plate], body_m: Cloud, direction: Vector3 | None, rate_hz: float
) -> tuple[Vector3 | None, Remark] | None:
    """Direction of walking on a treadmill and a remark with its speed; None if the walk is over ground.

    ``tracks`` are the markers, ``body_m`` the same as a cloud (frames x markers x 3), ``direction`` the direction of
    travel, None if the body stays in place. For a person who stands still the belts are stopped, whatever is stated.
    Raises ``InvalidInput`` (``belt-speed-contradicts-feet``) if a stated belt speed is not that of the surface on which
    the feet stand.
    """
    if not plates:
        return None
    stated = {plate.index: plate.belt_speed_m_s for plate in plates if plate.belt_speed_m_s is not None}
    heights = [float(np.nanmedian(track[:, 2])) for track in tracks]
    low = [tracks[int(i)] for i in np.argsort(heights)[: max(2, len(tracks) // 4)]]
    belt = stance_velocity_m_s(low[:_FEET_MARKERS], rate_hz)
    belt_m_s = float(np.linalg.norm(belt))
    ahead = orientation.belt_direction(low, rate_hz) if direction is None else None
    if stated and direction is None and ahead is None and belt_m_s < _STOPPED_M_S:
        return None, Remark("belt-stopped", "The feet stand still: the stated belt speeds are not used.")
    if stated:
        _require_belt_of_feet(stated, belt_m_s)
        speeds = " and ".join(f"{speed:.2f} m/s (plate {index})" for index, speed in sorted(stated.items()))
        message = (
            f"The belts move at {speeds}, as stated; the feet stand on a surface that moves at {belt_m_s:.2f} m/s."
        )
        return -belt / belt_m_s if ahead is None else ahead, Remark(TREADMILL, message)
    remark = Remark(TREADMILL, f"The feet stand on a surface that moves at {belt_m_s:.2f} m/s: taken for a treadmill.")
    if direction is None:
        return None if ahead is None else (ahead, remark)
    travel = orientation.travel_m(body_m, rate_hz)
    if travel is None or belt_m_s < _MIN_BELT_M_S:
        return None
    drift_m_s = float(np.linalg.norm(travel[:2])) * rate_hz / len(body_m)
    return (-belt / belt_m_s, remark) if drift_m_s < _DRIFT_SHARE * belt_m_s else None


def _require_belt_of_feet(stated: Mapping[int, float], feet_m_s: float) -> None:
    """Raise unless the speed of the standing feet is between the stated belt speeds, up to the tolerance."""
    least_m_s = (1.0 - BELT_TOLERANCE) * min(stated.values()) - _BELT_TOLERANCE_M_S
    most_m_s = (1.0 + BELT_TOLERANCE) * max(stated.values()) + _BELT_TOLERANCE_M_S
    if least_m_s <= feet_m_s <= most_m_s and feet_m_s > 0.0:
        return
    faults = [Fault(f"plates.{index}.belt_speed_m_s", f"{speed:g} m/s stated") for index, speed in stated.items()]
    raise InvalidInput(
        "belt-speed-contradicts-feet",
        f"The feet stand on a surface that moves at {feet_m_s:.2f} m/s, which the stated belt speeds contradict.",
        faults,
    )


def is_treadmill(recording: Recording) -> bool:
    """Whether the recording was made on a treadmill, as stated or detected by the reader."""
    return any(remark.code == TREADMILL for remark in recording.remarks)


def stated_belts_m_s(recording: Recording) -> dict[int, float]:
    """Stated belt speed of each plate that has one, by plate index."""
    return {plate.index: plate.belt_speed_m_s for plate in recording.plates if plate.belt_speed_m_s is not None}


def surface_velocities_m_s(recording: Recording, feet: Mapping[Side, Sequence[Points]]) -> dict[Side, Vector3]:
    """Velocity of the surface under each foot: zero over ground, that of its belt on a treadmill.

    ``feet`` has the marker tracks (frames x 3) of each foot. Of stated belts each foot has the one whose speed is
    nearest to its own in stance; a foot that is not marked is left out.
    """
    marked = {side: tracks for side, tracks in feet.items() if tracks}
    if not is_treadmill(recording):
        return {side: np.zeros(3) for side in marked}
    rate_hz, ahead = recording.marker_rate_hz, recording.walking_direction
    own = {side: stance_velocity_m_s(tracks, rate_hz) for side, tracks in marked.items()}
    stated = list(stated_belts_m_s(recording).values())
    if stated and ahead is not None:
        speeds = {side: float(np.linalg.norm(v)) for side, v in own.items()}
        return {side: -min(stated, key=lambda s, v=v: abs(s - v)) * ahead for side, v in speeds.items()}  # type: ignore[misc]
    common = stance_velocity_m_s([track for tracks in marked.values() for track in tracks], rate_hz) if marked else None
    if common is None or any(np.linalg.norm(v - common) > SPLIT_SHARE * np.linalg.norm(common) for v in own.values()):
        return own
    return dict.fromkeys(own, common)


def mean_surface_m_s(velocities: Mapping[Side, Vector3]) -> Vector3:
    """Velocity of the ground for the body as a whole: the mean over the feet; zero without any."""
    return np.asarray(np.mean(list(velocities.values()), axis=0)) if velocities else np.zeros(3)


def stance_velocity_m_s(tracks: Sequence[Points], rate_hz: float) -> Vector3:
    """Median horizontal velocity of foot markers while they are low: that of the belt on a treadmill, else near 0."""
    low = []
    for track in tracks:
        v = velocity_m_s(track, rate_hz)
        low.append(v[track[:, 2] <= np.nanpercentile(track[:, 2], 30.0)])
    return np.asarray(np.nanmedian(np.concatenate(low), axis=0) * [1.0, 1.0, 0.0], dtype=np.float64)


def velocity_m_s(track: Points, rate_hz: float) -> Points:
    """Central difference over 20 ms (one-sided at the ends): wide enough for 1 mm of marker noise at 200 Hz."""
    k = max(1, round(_HALF_SPAN_S * rate_hz))
    i = np.arange(len(track))
    before, after = np.maximum(i - k, 0), np.minimum(i + k, len(track) - 1)
    return np.asarray((track[after] - track[before]) * (rate_hz / np.maximum(after - before, 1))[:, None])
