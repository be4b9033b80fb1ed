"""Outline of a foot on the floor from its markers, including the parts that carry load beyond the markers.

The toes extend 6 to 8 cm (adults) in front of a marker on the metatarsal heads, and half of the foot's breadth lies
beside a marker on the midline. With d the distance from the heel marker to the ball of the foot, the foot's length is
L = d / 0.72 (0.68 for the middle of the first and fifth metatarsal heads, 0.63 for the fifth alone, 0.97 for a marker
on the toe), and at most 0.175 H with H the stature if known (a foot of 0.152 H in a shoe). The breadth at the ball is
0.36 L, the ratio of 0.055 H to 0.152 H, and at the heel 0.24 L. The round heel touches the floor 0.06 L (1.5 cm) in
front of its marker.
"""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Bool, Float

from stridelab.conventions import Points
from stridelab.recordings.foot_contact import Foot
from stridelab.recordings.recording import Recording

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
