"""When the load on a plate begins and ends.

A contact is loaded from the plate's threshold (20 N) on. Some laboratories store plates with a dead band: the
Rehazenter files hold nothing below 53 N. There the foot strikes before and leaves after the first and the last sample
that is stored, and the line through the nearest samples says when the load was zero: 10 ms earlier and 11 ms later at
a normal pace (C4). Double support without this is 27 ms shorter than in the files' events, with it 8 ms.
"""

from typing import Final

import numpy as np

from stridelab.recordings.recording import Plate
from stridelab.recordings.steps import loaded_intervals

DEAD_BAND: Final = 1.5
"""A contact whose first (last) sample carries this many thresholds was cut."""
RISE_S, FALL_S = 0.005, 0.01
"""Stretches through which the line goes: a heel loads faster than toes unload."""
MOST_BEFORE_S, MOST_AFTER_S = 0.02, 0.03


def contact_intervals(plate: Plate, rate_hz: float) -> list[tuple[float | None, float | None]]:
    """Start and end of each contact in seconds of the force's clock; None where the recording cuts it off."""
    load = np.linalg.norm(plate.force_n, axis=1)
    found: list[tuple[float | None, float | None]] = []
    for start_s, end_s in loaded_intervals(plate, rate_hz):
        i, j = round(start_s * rate_hz), round(end_s * rate_hz)
        begins = None if i == 0 else start_s - _beyond_s(load[i:], plate.threshold_n, rate_hz, RISE_S, MOST_BEFORE_S)
        last = j >= len(load) - 1
        ends = None if last else end_s + _beyond_s(load[j::-1], plate.threshold_n, rate_hz, FALL_S, MOST_AFTER_S)
        found.append((begins, ends))
    return found


def _beyond_s(load: np.ndarray, threshold_n: float, rate_hz: float, stretch_s: float, most_s: float) -> float:
    """How long before the first sample of ``load`` it was zero; 0 where nothing was cut."""
    if load[0] < DEAD_BAND * threshold_n:
        return 0.0
    n = min(max(3, round(stretch_s * rate_hz)), len(load))
    slope, at_start = np.polyfit(np.arange(n) / rate_hz, load[:n], 1)
    return float(min(max(at_start / slope, 0.0), most_s)) if slope > 0.0 else most_s
