"""Kinematics of markers over the floor: zero-phase velocities, the pelvis, and the walking speed."""

from collections.abc import Mapping
from functools import cache
from typing import Final

import numpy as np
from jaxtyping import Float
from scipy.signal import butter, sosfiltfilt

from stridelab.conventions import Points, Series, Vector3
from stridelab.recordings.gap_filling import true_runs
from stridelab.recordings.recording import Recording

LOW_PASS_HZ: Final = 15.0
"""Second order, forward and backward: a foot's swing is below 8 Hz, marker noise extends above."""
MIN_RUN_SAMPLES: Final = 16
"""Minimum number of consecutive samples for the filter."""
MIN_SPEED_M_S: Final = 0.2
"""Lower bound of the walking speed with which the limits scale."""
PELVIS: Final = ("l_asis", "r_asis", "l_psis", "r_psis", "sacrum")


def smooth_velocity_m_s(track_m: Points, rate_hz: float) -> Points:
    """Central differences of the low-passed track; NaN in visible runs shorter than ``MIN_RUN_SAMPLES`` samples."""
    velocity = np.full_like(track_m, np.nan)
    for i, j in true_runs(np.isfinite(track_m).all(axis=1)):
        if j - i >= MIN_RUN_SAMPLES:
            part = track_m[i:j]
            if rate_hz > 2.5 * LOW_PASS_HZ:
                part = sosfiltfilt(_low_pass(rate_hz), part, axis=0)
            velocity[i:j] = np.gradient(part, axis=0) * rate_hz
    return velocity


@cache
def _low_pass(rate_hz: float) -> Float[np.ndarray, "sections 6"]:
    return np.asarray(butter(2, LOW_PASS_HZ, fs=rate_hz, output="sos"))


def pelvis_m(recording: Recording, landmarks: Mapping[str, str]) -> Points:
    """Mean of the gap-free pelvis markers, or of all if none is gap-free (all markers without a pelvis)."""
    labels = [landmarks[name] for name in PELVIS if landmarks.get(name) in recording.markers_m]
    tracks = [recording.markers_m[label] for label in labels] or list(recording.markers_m.values())
    whole = [track for track in tracks if np.isfinite(track).all()]
    return np.asarray(np.mean(whole or tracks, axis=0))


def walking_speed_m_s(recording: Recording, landmarks: Mapping[str, str], floor_m_s: Vector3) -> float:
    """Median horizontal speed of the pelvis over the floor while it moves, at least ``MIN_SPEED_M_S``."""
    velocity = smooth_velocity_m_s(pelvis_m(recording, landmarks), recording.marker_rate_hz) - floor_m_s
    speed = level_speed_m_s(velocity)
    moving = speed[speed > MIN_SPEED_M_S]
    return float(np.median(moving)) if len(moving) else MIN_SPEED_M_S


def level_speed_m_s(velocity_m_s: Points) -> Series:
    """Horizontal speed."""
    return np.asarray(np.linalg.norm(velocity_m_s[:, :2], axis=1))
