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
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from jaxtyping import Bool, Float

from stridelab.conventions import Mask, Points, Series, Vector3
from stridelab.recordings.gap_filling import bridge_segment_gaps
from stridelab.recordings.orientation import travel_m
from stridelab.recordings.recording import Recording, Side
from stridelab.recordings.treadmill import (
    is_treadmill,
    mean_surface_m_s,
    surface_velocities_m_s,
    velocity_m_s,
)

LANDING_SPEED_SHARE, LIFT_OFF_SPEED_SHARE = 0.4, 1.3
_PEAK_PER_SPEED = 3.5
"""Peak foot speed over walking speed; gives the reference speed when the body stays in place."""
_MIN_SPEED_M_S = 0.3
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
    tracks = {side: _foot_tracks(recording, landmarks, prefix) for side, prefix in SIDES}
    if any(len(heel) == 0 or len(fore) == 0 for heel, fore in tracks.values()):
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
        hidden = np.isnan(speeds)
        unseen = hidden[:, : len(heel)].all(axis=1) | hidden[:, len(heel) :].all(axis=1)
        feet.append(Foot(side, np.stack(heel + fore, axis=1), resting, contact, unseen, ground[side]))
    return tuple(feet)


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
