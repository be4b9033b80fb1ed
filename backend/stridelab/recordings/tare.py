"""What a plate reads while nothing stands on it."""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import uniform_filter1d

from stridelab.conventions import Mask, Points, Series, Vector3
from stridelab.recordings.gaps import runs

MAX_TARE_N = 60.0
"""A steady upward reading above this, with no word from the file, is somebody standing there."""
_BAND_N = 6.0
_LOAD_N = 100.0
_MIN_STRETCH = 40
_SMOOTH = 21


@dataclass(frozen=True)
class Tare:
    """Offset in the plate's axes (sensor moment); ``refused`` when the plate is never unloaded."""

    force_n: Vector3
    moment_nm: Vector3
    refused: bool


def find_tare(force_n: Points, moment_nm: Points, upward_n: Series, zero_samples: tuple[int, int] | None) -> Tare:
    """Median of the unloaded stretches, after the frames that FORCE_PLATFORM:ZERO names if these are unloaded.

    ``upward_n`` is the plate's upward force. A load only adds to it, so the unloaded level is its lowest steady level
    (5th percentile of the smoothed signal); stretches of at least 40 samples within 6 N of it count as unloaded.
    """
    if not upward_n.any():
        return Tare(np.zeros(3), np.zeros(3), refused=False)
    smooth = uniform_filter1d(upward_n, min(_SMOOTH, len(upward_n)))
    floor_n = float(np.percentile(smooth, 5.0))
    named = _named_unloaded(smooth, floor_n, zero_samples)
    if named is not None:
        unloaded = named
    else:
        if not abs(floor_n) <= MAX_TARE_N:
            return Tare(np.zeros(3), np.zeros(3), refused=True)
        unloaded = np.zeros(len(smooth), dtype=bool)
        for i, j in runs(np.abs(smooth - floor_n) <= _BAND_N):
            if j - i >= _MIN_STRETCH:
                unloaded[i:j] = True
    if not unloaded.any():
        return Tare(np.zeros(3), np.zeros(3), refused=True)
    return Tare(np.median(force_n[unloaded], axis=0), np.median(moment_nm[unloaded], axis=0), refused=False)


def _named_unloaded(smooth: Series, floor_n: float, zero_samples: tuple[int, int] | None) -> Mask | None:
    """The samples that the file says to average, if they are as low as the signal ever is.

    Above ``MAX_TARE_N`` they are believed only where a load comes on top: else somebody stands there all along.
    """
    if zero_samples is None:
        return None
    first, last = zero_samples
    if not 1 <= first < last <= len(smooth):
        return None
    level_n = float(np.mean(smooth[first - 1 : last]))
    if level_n > floor_n + 2.0 * _BAND_N:
        return None
    if level_n > MAX_TARE_N and float(np.percentile(smooth, 98.0)) < level_n + _LOAD_N:
        return None
    mask = np.zeros(len(smooth), dtype=bool)
    mask[first - 1 : last] = True
    return mask
