"""Contact intervals on the plates, and the whole steps between them.

Detects contact force that the plates do not measure: they carry less than the motion of the body requires.

With m the mass, z the height of the markers' centre of mass and f_z the sum of the plates, both low-passed at 4 Hz,

    D(t) = min over |s| <= 30 ms of (g + z''(t + s)) / g - f_z(t) / (m g)

is the missing share of body weight, carried by a chair, a rail, a stick or the floor beside the plate. In free fall
z'' = -g, and no force is missing. The minimum over 30 ms allows for the latency between force and markers.
"""

from collections.abc import Sequence

import numpy as np
from scipy.ndimage import minimum_filter1d

from stridelab.conventions import GRAVITY_M_S2, Mask, Series, Vector3
from stridelab.recordings.body_mass import VerticalMotion, low_band
from stridelab.recordings.gap_filling import true_runs
from stridelab.recordings.recording import Plate, Recording, Remark, Window
from stridelab.recordings.total_wrench import low_pass

_MIN_CONTACT_S = 0.06
_MERGE_S = 0.03
_MIN_PEAK_N = 60.0
_MIN_STEP_S = 0.25


def loaded_intervals(plate: Plate, rate_hz: float) -> list[tuple[float, float]]:
    """Start and end of each contact in seconds; brief dips are bridged, ringing and brief touches are ignored."""
    loaded = plate.loaded
    for i, j in true_runs(~loaded):
        if i > 0 and j < len(loaded) and (j - i) < _MERGE_S * rate_hz:
            loaded[i:j] = True
    up_n = plate.force_n[:, 2]
    return [
        (i / rate_hz, (j - 1) / rate_hz)
        for i, j in true_runs(loaded)
        if (j - i >= _MIN_CONTACT_S * rate_hz or j - i == len(loaded)) and float(up_n[i:j].max()) > _MIN_PEAK_N
    ]


def whole_steps(recording: Recording, window: Window) -> list[tuple[float, float]]:
    """Longest intervals of the window with a whole number of steps: strike to strike, and lift-off to lift-off.

    Strikes and lift-offs are those of the plates; the window's start is a lift-off and its end a strike (of a foot
    beside the plates) unless the recording itself starts or ends there.
    """
    frame_s = 1.0 / recording.marker_rate_hz
    strikes: list[float] = []
    lifts: list[float] = []
    for plate in recording.plates:
        if plate.use:
            for start_s, end_s in loaded_intervals(plate, recording.force_rate_hz):
                strikes.append(start_s)
                lifts.append(end_s)
    inside = (window.start_s + frame_s, window.end_s - frame_s)
    strikes = [t for t in strikes if inside[0] < t < inside[1]]
    lifts = [t for t in lifts if inside[0] < t < inside[1]]
    if strikes and window.end_s < recording.duration_s - 2.5 * frame_s:
        strikes.append(window.end_s)
    if lifts and window.start_s > 1.5 * frame_s:
        lifts.append(window.start_s)
    spans = [(min(instants), max(instants)) for instants in (strikes, lifts) if instants]
    return [(first_s, last_s) for first_s, last_s in spans if last_s - first_s >= _MIN_STEP_S]


def fore_aft_remarks(plates: tuple[Plate, ...], direction: Vector3 | None, rate_hz: float) -> list[Remark]:
    """Remark on plates that may be turned: they show propulsion before braking in every contact."""
    if direction is None:
        return []
    turned = []
    for plate in plates:
        along_n = plate.force_n @ direction
        signs = []
        for start_s, end_s in loaded_intervals(plate, rate_hz):
            i, j = round(start_s * rate_hz), round(end_s * rate_hz)
            k = (i + j) // 2
            brake_n, push_n = float(along_n[i:k].mean()), float(along_n[k:j].mean())
            if j - i >= 0.25 * rate_hz and min(abs(brake_n), abs(push_n)) > 0.02 * float(plate.force_n[i:j, 2].mean()):
                signs.append(brake_n > 0.0 > push_n)
        if signs and all(signs):
            turned.append(plate.index)
    if not turned:
        return []
    which = ", ".join(str(index) for index in turned)
    message = f"Plate {which}: the foot speeds up when it lands and slows down when it leaves; the plate may be turned."
    return [Remark("fore-aft-reversed", message)]


def vertical_force_n(recording: Recording) -> Series:
    """Upward force of all plates in use at the force rate."""
    return np.asarray(np.sum([plate.force_n[:, 2] for plate in recording.plates if plate.use], axis=0))


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
    reach = 2 * max(1, round(_LATENCY_S * rate_hz)) + 1
    for (i, j), carried_n in force_n.items():
        needed = minimum_filter1d(1.0 + motion.acceleration_m_s2[i:j] / GRAVITY_M_S2, reach)
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
