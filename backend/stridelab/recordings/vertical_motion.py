"""Vertical motion of the body from its markers, to be compared with the vertical force of all contacts.

The height of the centre of mass comes from the segment model. If the model cannot be placed (a marker of the legs is
missing), the mean height of the pelvis markers is used instead, with a larger error.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.signal import butter, sosfiltfilt

from stridelab.conventions import Mask, Points, Series
from stridelab.recordings.gap_filling import true_runs
from stridelab.recordings.recording import Recording

BAND_HZ = 4.0
"""Low-pass of accelerations: steps and jumps lie below it; above it, soft tissue and marker noise dominate."""
VELOCITY_BAND_HZ = 10.0
"""Low-pass of velocities: 4 Hz would remove 6 % of those of a walk with 2 steps per second."""
PELVIS = ("l_asis", "r_asis", "l_psis", "r_psis", "sacrum")
_MIN_RUN_S = 0.25


@dataclass(frozen=True)
class VerticalMotion:
    """Upward velocity and acceleration of the centre of mass at the marker instants, low-passed; NaN where unknown.

    The acceleration is low-passed at ``BAND_HZ``, the velocity at ``VELOCITY_BAND_HZ``. ``from_pelvis`` is true if the
    pelvis is used instead of the centre of mass.
    """

    velocity_m_s: Series
    acceleration_m_s2: Series
    from_pelvis: bool = False

    @property
    def known_frames(self) -> Mask:
        """Frames whose motion is known."""
        return np.asarray(np.isfinite(self.acceleration_m_s2))


def vertical_motion(
    recording: Recording, landmarks: Mapping[str, str], com_m: Points | None = None
) -> VerticalMotion | None:
    """Motion of ``com_m`` (frames x 3, the geometric centre of mass), else of the pelvis; None without either."""
    if com_m is not None:
        return _differentiate_height(com_m[:, 2], recording.marker_rate_hz, from_pelvis=False)
    labels = [landmarks[name] for name in PELVIS if landmarks.get(name) in recording.markers_m]
    if not labels:
        return None
    height_m = np.mean([recording.markers_m[label][:, 2] for label in labels], axis=0)
    return _differentiate_height(height_m, recording.marker_rate_hz, from_pelvis=True)


def low_band(track: Series, rate_hz: float, band_hz: float = BAND_HZ) -> Series:
    """Zero-phase Butterworth low-pass of second order; too slowly sampled tracks are returned unchanged."""
    if rate_hz <= 2.5 * band_hz or len(track) < 3:
        return track
    pad = min(len(track) - 1, round(rate_hz / band_hz))
    return np.asarray(sosfiltfilt(butter(2, band_hz, fs=rate_hz, output="sos"), track, padlen=pad))


def _differentiate_height(height_m: Series, rate_hz: float, *, from_pelvis: bool) -> VerticalMotion | None:
    velocity = np.full(len(height_m), np.nan)
    acceleration = velocity.copy()
    for i, j in true_runs(np.isfinite(height_m)):
        if j - i >= max(3.0, _MIN_RUN_S * rate_hz):
            velocity[i:j] = np.gradient(low_band(height_m[i:j], rate_hz, VELOCITY_BAND_HZ)) * rate_hz
            slow = low_band(height_m[i:j], rate_hz)
            acceleration[i:j] = np.gradient(np.gradient(slow)) * rate_hz**2
    if not np.isfinite(velocity).any():
        return None
    return VerticalMotion(velocity, acceleration, from_pelvis)
