"""Finds the frames in which force is missing: the plates carry less than the motion of the body requires.

With m the mass, z the height of the markers' centre of mass and f_z the sum of the plates, both low-passed at 4 Hz,

    D(t) = min over |s| <= 30 ms of (g + z''(t + s)) / g - f_z(t) / (m g)

is the missing share of body weight, carried by a chair, a rail, a stick or the floor beside the plate. In free fall
z'' = -g, and no force is missing. The minimum over 30 ms allows for the latency between force and markers.
"""

from collections.abc import Sequence
from typing import Final

import numpy as np

from stridelab.conventions import GRAVITY_M_S2, Mask, Series
from stridelab.recordings.body_mass import VerticalMotion, low_band
from stridelab.recordings.gap_filling import true_runs
from stridelab.recordings.plate_contacts import low_pass, vertical_force_n, whole_steps
from stridelab.recordings.recording import Recording, Window

FORCE_MISSING: Final = "force-missing"
"""Code of the remark on these frames."""
MISSING_SHARE, MISSING_SHARE_BY_PELVIS = 0.2, 0.4
"""Share of body weight above which force is missing. The largest D in windows without a fault is 0.12 (fast walks)."""
_CLEAR = 0.5
"""An interval of missing force extends until the missing share falls below this fraction of the limit."""
_LATENCY_S = 0.03
_LIFTED_M_S2 = 4.0
"""Frames with a smaller g + z'' are not used to estimate the mass."""
_LEVEL_PERCENTILE = 75.0
_LIGHT, _ABSURD, _STEADY = 1.1, 1.5, 0.3


def frames_missing_force(
    recording: Recording, windows: Sequence[Window], motion: VerticalMotion, stated_kg: float | None
) -> Mask:
    """Frames of the candidate ``windows`` in which force is missing; False where the motion is unknown."""
    missing = np.zeros(recording.n_frames, dtype=bool)
    rate_hz = recording.marker_rate_hz
    up_n = _force_at_frames(recording)
    spans = []
    for window in windows:
        i, j = round(window.start_s * rate_hz), round(window.end_s * rate_hz) + 1
        spans += [(i + a, i + b) for a, b in true_runs(motion.known_frames[i:j]) if b - a >= 3]
    force_n = {span: low_band(up_n[slice(*span)], rate_hz) for span in spans}
    mass_kg = _plate_level_kg(recording, windows, force_n, motion, stated_kg)
    if mass_kg is None:
        return missing
    limit = MISSING_SHARE_BY_PELVIS if motion.from_pelvis else MISSING_SHARE
    reach = max(1, round(_LATENCY_S * rate_hz))
    for (i, j), carried_n in force_n.items():
        padded = np.pad(1.0 + motion.acceleration_m_s2[i:j] / GRAVITY_M_S2, reach, constant_values=np.inf)
        needed = np.lib.stride_tricks.sliding_window_view(padded, 2 * reach + 1).min(axis=1)
        lacking = needed - carried_n / (mass_kg * GRAVITY_M_S2)
        for a, b in true_runs(lacking > _CLEAR * limit):
            missing[i + a : i + b] = bool(lacking[a:b].max() > limit)
    return missing


def _plate_level_kg(
    recording: Recording,
    windows: Sequence[Window],
    force_n: dict[tuple[int, int], Series],
    motion: VerticalMotion,
    stated_kg: float | None,
) -> float | None:
    """Mass that the plates carry when no force is missing: the upper quartile of f_z / (g + z'').

    A given mass that is larger by 10 % is used instead, unless the plates carry their level steadily over a whole step
    or in quiet stance, or the given mass is larger by 50 %: then the given mass is considered wrong.
    """
    ratios = []
    for (i, j), carried_n in force_n.items():
        needed = GRAVITY_M_S2 + motion.acceleration_m_s2[i:j]
        ratios.append(carried_n[needed > _LIFTED_M_S2] / needed[needed > _LIFTED_M_S2])
    ratio = np.concatenate([np.zeros(0), *ratios])
    if len(ratio) == 0:
        return None
    low, middle, level, high = np.percentile(ratio, (10.0, 50.0, _LEVEL_PERCENTILE, 90.0))
    if stated_kg is not None and _LIGHT * level < stated_kg < _ABSURD * level:
        stands = recording.walking_direction is None
        whole = stands or any(whole_steps(recording, window) for window in windows)
        if not (whole and high - low < _STEADY * middle):
            return stated_kg
    return float(level) if level > 0.0 else None


def _force_at_frames(recording: Recording) -> Series:
    """Upward force of the plates in use at the marker instants, low-passed to remove plate ringing."""
    up_n = vertical_force_n(recording)
    smooth = low_pass(np.column_stack([np.zeros_like(up_n), np.zeros_like(up_n), up_n]), recording.force_rate_hz)[:, 2]
    return np.asarray(np.interp(recording.time_s, np.arange(len(smooth)) / recording.force_rate_hz, smooth))
