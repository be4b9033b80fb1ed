"""Detects when a foot may be on the ground, from its markers alone.

A marker of a standing foot is slow, that of a swinging foot fast; the limits scale with the walking speed v. A swinging
foot lands when any of its markers falls below 0.4 v, and lifts off when all of them exceed 1.3 v: at the instants of
contact on force plates the slowest forefoot marker moves at 1.28 v (median of 84 lift-offs) and the heel at 0.35 v (110
strikes) in adults at 0.3 to 2.2 m/s. Both limits favour contact.

Outline of a foot on the floor from its markers, including the parts that carry load beyond the markers.

The toes extend 6 to 8 cm (adults) in front of a marker on the metatarsal heads, and half of the foot's breadth lies
beside a marker on the midline. With d the distance from the heel marker to the ball of the foot, the foot's length is
L = d / 0.72 (0.68 for the middle of the first and fifth metatarsal heads, 0.63 for the fifth alone, 0.97 for a marker
on the toe), and at most 0.175 H with H the stature if known (a foot of 0.152 H in a shoe). The breadth at the ball is
0.36 L, the ratio of 0.055 H to 0.152 H, and at the heel 0.24 L. The round heel touches the floor 0.06 L (1.5 cm) in
front of its marker.

Treadmills: detection, the speed of each belt, and the velocity of the surface under each foot.

A belt's speed is stated by the user, or estimated from the standing feet: the median velocity of the foot markers while
they are low. The two belts of a split-belt treadmill may differ; each foot then has the belt that it stands on.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from jaxtyping import Bool, Float

from stridelab.conventions import Mask, Points, Series, Vector3
from stridelab.errors import Fault, InvalidInput
from stridelab.recordings import orientation
from stridelab.recordings.files.raw import Cloud
from stridelab.recordings.gap_filling import bridge_segment_gaps
from stridelab.recordings.orientation import travel_m
from stridelab.recordings.recording import Recording, Remark, Side

LANDING_SPEED_SHARE, LIFT_OFF_SPEED_SHARE = 0.4, 1.3
_PEAK_PER_SPEED = 3.5
"""Peak foot speed over walking speed; gives the reference speed when the body stays in place."""
_MIN_SPEED_M_S = 0.3
_ABOVE_BELT_M: Final = 0.05
"""Height of a foot's lowest marker above where it stands: 2 cm at most while a plate is loaded by the toes."""
_LEVEL_SLOPE: Final = 0.03
SIDES: Final[tuple[tuple[Side, str], ...]] = (("left", "l_"), ("right", "r_"))
"""Both sides with the prefix of their landmarks."""
FOOT_LANDMARKS = ("heel", "toe", "mt1", "mt2", "mt5")


@dataclass(frozen=True)
class Foot:
    """Markers of one foot (frames x markers x 3) and, per frame, whether it may touch the ground.

    ``resting`` marks, per frame and marker, whether the marker is visible and slow enough to carry load. In ``unseen``
    frames the heel or the whole forefoot is hidden, so ``contact`` is unreliable. ``ground_m_s`` is the velocity of the
    surface under the foot: that of its belt on a treadmill, else zero.
    """

    side: Side
    markers_m: Float[np.ndarray, "n markers 3"]
    resting: Bool[np.ndarray, "n markers"]
    contact: Mask
    unseen: Mask
    ground_m_s: Vector3 = field(default_factory=lambda: np.zeros(3))


def find_feet(recording: Recording, landmarks: Mapping[str, str]) -> tuple[Foot, ...]:
    """Both feet; empty if either foot has no heel marker or no forefoot marker."""
    feet = find_marked_feet(recording, landmarks)
    return feet if len(feet) == len(SIDES) else ()


def find_marked_feet(recording: Recording, landmarks: Mapping[str, str]) -> tuple[Foot, ...]:
    """The feet with a heel marker and a forefoot marker: both, one or none."""
    tracks = {side: _foot_tracks(recording, landmarks, prefix) for side, prefix in SIDES}
    tracks = {side: (heel, fore) for side, (heel, fore) in tracks.items() if heel and fore}
    if not tracks:
        return ()
    rate_hz = recording.marker_rate_hz
    ground = surface_velocities_m_s(recording, {side: heel + fore for side, (heel, fore) in tracks.items()})
    feet = []
    fastest = 0.0
    for side, (heel, fore) in tracks.items():
        for track in heel + fore:
            fastest = max(fastest, _high_percentile(speed_m_s(track, rate_hz, ground[side])))
    reference_m_s = _reference_speed(recording, fastest)
    for side, (heel, fore) in tracks.items():
        speeds = np.column_stack([speed_m_s(track, rate_hz, ground[side]) for track in heel + fore])
        contact = contact_states(speeds, reference_m_s)
        resting = (np.nan_to_num(speeds, nan=np.inf) < LIFT_OFF_SPEED_SHARE * reference_m_s) & contact[:, None]
        resting &= ~_above_level_belt(heel + fore, resting, ground[side], rate_hz)[:, None]
        hidden = np.isnan(speeds)
        unseen = hidden[:, : len(heel)].all(axis=1) | hidden[:, len(heel) :].all(axis=1)
        feet.append(Foot(side, np.stack(heel + fore, axis=1), resting, contact, unseen, ground[side]))
    return tuple(feet)


def _above_level_belt(
    tracks: Sequence[Points], resting: Bool[np.ndarray, "n markers"], ground_m_s: Vector3, rate_hz: float
) -> Mask:
    """Frames in which every visible marker is higher than where it stands on a level belt; none over ground.

    A foot that has just left a belt still moves at its speed. ``resting`` are the frames and markers of that speed; a
    foot that rises or sinks in most of those in which it is low stands on an inclined belt.
    """
    above = np.zeros(len(resting), dtype=bool)
    belt_m_s = float(np.linalg.norm(ground_m_s))
    seen = [k for k, track in enumerate(tracks) if np.isfinite(track[:, 2]).any()]
    if belt_m_s == 0.0 or not seen:
        return above
    height_m = np.column_stack([tracks[k][:, 2] for k in seen])
    above_m = height_m - np.nanpercentile(height_m, _LOW_PERCENTILE, axis=0)
    rise_m_s = np.column_stack([velocity_m_s(tracks[k], rate_hz)[:, 2] for k in seen])
    stands = rise_m_s[resting[:, seen] & (above_m <= 0.0)]
    if not stands.size or abs(float(np.median(stands))) > _LEVEL_SLOPE * belt_m_s:
        return above
    return np.asarray(np.nan_to_num(above_m, nan=np.inf).min(axis=1) > _ABOVE_BELT_M)


def _foot_tracks(recording: Recording, landmarks: Mapping[str, str], prefix: str) -> tuple[list[Points], list[Points]]:
    """Tracks at the heel and at the forefoot; each landmark has one label. Short gaps of one marker are bridged."""
    tracks: dict[str, Points] = {}
    for name in (*FOOT_LANDMARKS, "ankle_lateral"):
        label = landmarks.get(prefix + name)
        if label is not None and label in recording.markers_m:
            tracks[name] = recording.markers_m[label]
    tracks = bridge_segment_gaps(tracks, recording.marker_rate_hz)
    ankle = tracks.pop("ankle_lateral", None)
    rear = tracks.pop("heel", ankle)
    return [] if rear is None else [rear], list(tracks.values())


def _high_percentile(speed: Series) -> float:
    return float(np.nanpercentile(speed, 98.0)) if np.isfinite(speed).any() else 0.0


def _reference_speed(recording: Recording, fastest_m_s: float) -> float:
    """Walking speed: travel over time; on a treadmill or in place, a fraction of the peak foot speed."""
    cloud = np.stack(list(recording.markers_m.values()), axis=1)
    travel = travel_m(cloud, recording.marker_rate_hz)
    speed = 0.0 if travel is None else float(np.linalg.norm(travel)) / recording.duration_s
    if speed < _MIN_SPEED_M_S or is_treadmill(recording):
        speed = fastest_m_s / _PEAK_PER_SPEED
    return max(speed, _MIN_SPEED_M_S)


def walking_surface_m_s(recording: Recording, landmarks: Mapping[str, str]) -> Vector3:
    """Velocity of the ground from the feet that ``landmarks`` (landmark to label) name; zero without any."""
    tracks: dict[Side, list[Points]] = {}
    for side, prefix in SIDES:
        labels = [landmarks.get(prefix + name) for name in (*FOOT_LANDMARKS, "ankle_lateral")]
        tracks[side] = [recording.markers_m[k] for k in labels if k is not None and k in recording.markers_m]
    return mean_surface_m_s(surface_velocities_m_s(recording, tracks))


def ground_of_feet_m_s(feet: Sequence[Foot]) -> Vector3:
    """Velocity of the ground for the body as a whole: the mean of the surfaces under the feet."""
    return mean_surface_m_s({foot.side: foot.ground_m_s for foot in feet})


def speed_m_s(track: Points, rate_hz: float, ground_m_s: Float[np.ndarray, "3"]) -> Series:
    """Speed of a marker against the ground."""
    return np.asarray(np.linalg.norm(velocity_m_s(track, rate_hz) - ground_m_s, axis=1))


def contact_states(speeds: Float[np.ndarray, "n markers"], reference_m_s: float) -> Mask:
    """Contact per frame, by hysteresis over the slowest visible marker; frames without any keep the previous state."""
    unseen = np.isnan(speeds).all(axis=1)
    slowest = np.where(unseen, np.nan, np.nanmin(np.where(unseen[:, None], 0.0, speeds), axis=1))
    contact = np.zeros(len(speeds), dtype=bool)
    down = True
    for i, v in enumerate(slowest):
        if down and v > LIFT_OFF_SPEED_SHARE * reference_m_s:
            down = False
        elif not down and v < LANDING_SPEED_SHARE * reference_m_s:
            down = True
        contact[i] = down
    return contact


_BALL = 0.72
_BALL_MIDDLE, _BALL_LATERAL, _TOE = 0.68, 0.63, 0.97
_SHOE = 0.175
_HALF_BREADTH, _HALF_HEEL = 0.18, 0.12
_HEEL_INSET = 0.06
_ANKLE = 0.25
"""Distance of the lateral ankle, used if the heel is not marked, in front of the heel, per foot length."""

Outline = Float[np.ndarray, "n 5 3"]


def foot_outline(recording: Recording, landmarks: Mapping[str, str], foot: Foot) -> Outline:
    """Inner and outer edge of the heel, both edges of the ball, and the tip of the toes (frames x 5 x 3), in metres.

    The points lie at the height of their markers. NaN where a marker they need is missing.
    """
    marked = {
        name: _landmark_track(recording, landmarks, foot.side[0] + "_" + name) for name in ("mt1", "mt2", "mt5", "toe")
    }
    mt1, mt2, mt5, toe = (marked[name] for name in ("mt1", "mt2", "mt5", "toe"))
    heel = foot.markers_m[:, 0]
    if mt1 is not None and mt5 is not None:
        ball, share = 0.5 * (mt1 + mt5), _BALL_MIDDLE
    elif mt2 is not None:
        ball, share = mt2, _BALL
    elif toe is not None:
        ball, share = toe, _TOE
    elif mt5 is not None:
        ball, share = mt5, _BALL_LATERAL
    else:
        ball, share = foot.markers_m[:, 1], _BALL
    distance_m = np.linalg.norm(ball - heel, axis=1)
    typical_m = float(np.nanmedian(distance_m)) if np.isfinite(distance_m).any() else np.nan
    ahead = 0.0 if _landmark_track(recording, landmarks, foot.side[0] + "_heel") is not None else _ANKLE
    length_m = typical_m / (share - ahead)
    if recording.subject.height_m is not None:
        length_m = max(min(length_m, _SHOE * recording.subject.height_m), typical_m / (_TOE - ahead))
    along = (ball - heel) * [1.0, 1.0, 0.0]
    along /= np.maximum(np.linalg.norm(along, axis=1), 1e-9)[:, None]
    across = np.column_stack([-along[:, 1], along[:, 0], np.zeros(len(along))])
    tip = ball + along * max((1.0 - ahead) * length_m - typical_m, 0.0)
    if share == _TOE:
        ball = ball - along * (_TOE - _BALL) * length_m
    beside_ball, beside_heel = across * _HALF_BREADTH * length_m, across * _HALF_HEEL * length_m
    back = heel + along * (_HEEL_INSET - ahead) * length_m
    return np.stack([back + beside_heel, back - beside_heel, ball + beside_ball, ball - beside_ball, tip], axis=1)


def resting_outline(foot: Foot) -> Bool[np.ndarray, "n 5"]:
    """Per frame and outline point: whether its part of the foot is slow enough to carry load."""
    heel, fore = foot.resting[:, :1], foot.resting[:, 1:].any(axis=1, keepdims=True)
    return np.concatenate([heel, heel, fore, fore, fore], axis=1)


def _landmark_track(recording: Recording, landmarks: Mapping[str, str], name: str) -> Points | None:
    label = landmarks.get(name)
    return None if label is None else recording.markers_m.get(label)


TREADMILL: Final = "treadmill"
"""Code of the remark on a recording that was made on a treadmill."""
SPLIT_SHARE: Final = 0.15
"""Relative difference of the feet's surfaces from which on the belts are taken for different."""
BELT_TOLERANCE: Final = 0.25
"""Relative difference between a stated belt speed and that of the feet; running feet are up to 10 % too slow."""
_BELT_TOLERANCE_M_S: Final = 0.1
_HALF_SPAN_S: Final = 0.01
_LOW_PERCENTILE: Final = 30.0
_FEET_MARKERS: Final = 4
_DRIFT_SHARE: Final = 0.25
"""A body that travels slower than this share of the belt's speed drifts on a treadmill."""
_MIN_BELT_M_S: Final = 0.3
_STOPPED_M_S: Final = 0.05
_STEADY_SHARE: Final = 0.25
"""Deviation of low markers from the belt's velocity, over that: 0.14 and less on 29 treadmills, wheelchairs 0.36."""


def detect_treadmill(
    tracks: Sequence[Points],
    stated: Mapping[int, float],
    body_m: Cloud,
    direction: Vector3 | None,
    rate_hz: float,
    *,
    plates: bool,
) -> tuple[Vector3 | None, Remark] | None:
    """Direction of walking on a treadmill and a remark with its speed; None if the walk is over ground.

    ``tracks`` are the markers, ``body_m`` the same as a cloud (frames x markers x 3), ``direction`` the direction of
    travel, None if the body stays in place. ``stated`` has the stated speeds of the belts by plate. Without ``plates``
    the low markers must move as steadily as feet on a belt: those of a wheelchair, a pedal or a dance do not. For a
    person who stands still the belts are stopped, whatever is stated. Raises ``InvalidInput``
    (``belt-speed-contradicts-feet``) if a stated belt speed is not that of the surface on which the feet stand.
    """
    if not tracks:
        return None
    heights = [float(np.nanmedian(track[:, 2])) for track in tracks]
    low = [tracks[int(i)] for i in np.argsort(heights)[: max(2, len(tracks) // 4)]]
    belt = stance_velocity_m_s(low[:_FEET_MARKERS], rate_hz)
    belt_m_s = float(np.linalg.norm(belt))
    ahead = orientation.belt_direction(low, rate_hz) if direction is None else None
    if stated and direction is None and ahead is None and belt_m_s < _STOPPED_M_S:
        return None, Remark("belt-stopped", "The feet stand still: the stated belt speeds are not used.")
    if stated:
        _require_belt_of_feet(stated, belt_m_s)
        what = "plate" if plates else "belt"
        speeds = " and ".join(f"{speed:.2f} m/s ({what} {index})" for index, speed in sorted(stated.items()))
        message = (
            f"The belts move at {speeds}, as stated; the feet stand on a surface that moves at {belt_m_s:.2f} m/s."
        )
        return -belt / belt_m_s if ahead is None else ahead, Remark(TREADMILL, message)
    if not plates and not (belt_m_s >= _MIN_BELT_M_S and _is_steady(low[:_FEET_MARKERS], rate_hz)):
        return None
    remark = Remark(TREADMILL, f"The feet stand on a surface that moves at {belt_m_s:.2f} m/s: taken for a treadmill.")
    if direction is None:
        return None if ahead is None else (ahead, remark)
    travel = orientation.travel_m(body_m, rate_hz)
    if travel is None or belt_m_s < _MIN_BELT_M_S:
        return None
    drift_m_s = float(np.linalg.norm(travel[:2])) * rate_hz / len(body_m)
    return (-belt / belt_m_s, remark) if drift_m_s < _DRIFT_SHARE * belt_m_s else None


def _is_steady(feet_m: Sequence[Points], rate_hz: float) -> bool:
    """Whether most markers, while they are low, move at one velocity, each at its own (the belts may differ)."""
    shares = []
    for track in feet_m:
        v = velocity_m_s(track, rate_hz)[track[:, 2] <= np.nanpercentile(track[:, 2], _LOW_PERCENTILE)]
        common = stance_velocity_m_s([track], rate_hz)
        shares.append(np.nanmedian(np.linalg.norm(v - common, axis=1)) / np.linalg.norm(common))
    return bool(np.median(shares) <= _STEADY_SHARE)


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
    """Stated belt speed of each plate that has one, by plate index; without plates of each belt."""
    on_plates = {plate.index: plate.belt_speed_m_s for plate in recording.plates if plate.belt_speed_m_s is not None}
    return {**recording.belts_m_s, **on_plates}


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
    """Median horizontal velocity of foot markers while they are low: that of the belt on a treadmill, else near 0.

    Zero if no marker is visible for long enough to have a velocity.
    """
    low = []
    for track in tracks:
        v = velocity_m_s(track, rate_hz)
        low.append(v[track[:, 2] <= np.nanpercentile(track[:, 2], _LOW_PERCENTILE)])
    v = np.concatenate(low)
    v = v[np.isfinite(v).all(axis=1)]
    return np.asarray(np.median(v, axis=0) * [1.0, 1.0, 0.0] if len(v) else np.zeros(3), dtype=np.float64)


def velocity_m_s(track: Points, rate_hz: float) -> Points:
    """Central difference over 20 ms (one-sided at the ends): wide enough for 1 mm of marker noise at 200 Hz."""
    k = max(1, round(_HALF_SPAN_S * rate_hz))
    i = np.arange(len(track))
    before, after = np.maximum(i - k, 0), np.minimum(i + k, len(track) - 1)
    return np.asarray((track[after] - track[before]) * (rate_hz / np.maximum(after - before, 1))[:, None])
