"""Detects static trials: the subject stands still while the markers are visible.

A marker's excursion is the 95th percentile of the distance from its median position. In a static trial it is at most
34 mm (a restless child; 7 mm is usual), in the slowest walk at 0.2 m/s more than 450 mm, on a treadmill more than
100 mm.
"""

from typing import Final

import numpy as np

from stridelab.recordings.recording import Recording

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
