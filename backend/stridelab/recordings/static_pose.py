"""Checks whether two recordings show the same body, by marker distances within the pelvis and the shanks.

Markers of one segment keep their distance except for skin motion. Between the static trial and the walks of one subject
(18 subjects, 36 walks) the medians of these distances differ by at most 8 mm; between two subjects of one laboratory
they differ by more than 20 mm in 95 % of 328 pairs.

Detects static trials: the subject stands still while the markers are visible.

A marker's excursion is the 95th percentile of the distance from its median position. In a static trial it is at most
34 mm (a restless child; 7 mm is usual), in the slowest walk at 0.2 m/s more than 450 mm, on a treadmill more than
100 mm.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations
from typing import Final

import numpy as np

from stridelab.recordings.recording import Recording

SAME_BODY_M: Final = 0.02
"""Largest difference of a distance between recordings of the same body."""
_PELVIS: Final = ("l_asis", "r_asis", "l_psis", "r_psis", "sacrum")
_SHANKS: Final = (("l_knee_lateral", "l_ankle_lateral"), ("r_knee_lateral", "r_ankle_lateral"))
_RIGID: Final = (*combinations(_PELVIS, 2), *_SHANKS)


@dataclass(frozen=True)
class BodyDifference:
    """The distance between two landmarks that differs most between two recordings, in metres."""

    landmarks: tuple[str, str]
    one_m: float
    other_m: float

    @property
    def difference_m(self) -> float:
        """Absolute difference of the two distances."""
        return abs(self.one_m - self.other_m)


def body_difference(
    one: Recording, one_landmarks: Mapping[str, str], other: Recording, other_landmarks: Mapping[str, str]
) -> BodyDifference | None:
    """Largest difference among the distances present in both recordings; None if they share none.

    ``one_landmarks`` and ``other_landmarks`` map landmark to label of the respective recording.
    """
    ones, others = _distances_m(one, one_landmarks), _distances_m(other, other_landmarks)
    shared = [BodyDifference(pair, ones[pair], others[pair]) for pair in ones if pair in others]
    return max(shared, key=lambda pair: pair.difference_m, default=None)


def _distances_m(recording: Recording, landmarks: Mapping[str, str]) -> dict[tuple[str, str], float]:
    """Median distance of each landmark pair over the frames in which both are visible."""
    tracks = {name: recording.markers_m[label] for name, label in landmarks.items() if label in recording.markers_m}
    medians_m = {}
    for a, b in _RIGID:
        if a in tracks and b in tracks:
            distance_m = np.linalg.norm(tracks[a] - tracks[b], axis=1)
            if np.isfinite(distance_m).any():
                medians_m[a, b] = float(np.nanmedian(distance_m))
    return medians_m


MAX_EXCURSION_M: Final = 0.05
"""Largest excursion of a marker of a standing subject."""
STILL_MARKER_SHARE: Final = 0.95
"""Share of the markers that must be still: some may be mislabelled temporarily."""
STILL_FRAME_SHARE: Final = 0.95


def stands_still(recording: Recording) -> bool:
    """Whether the markers stay in place; a recording of one frame counts as a static trial."""
    excursions = []
    for track in recording.markers_m.values():
        seen = track[np.isfinite(track).all(axis=1)]
        if len(seen):
            distance = np.linalg.norm(seen - np.median(seen, axis=0), axis=1)
            excursions.append(float(np.quantile(distance, STILL_FRAME_SHARE)))
    return bool(excursions) and float(np.mean(np.array(excursions) < MAX_EXCURSION_M)) >= STILL_MARKER_SHARE
