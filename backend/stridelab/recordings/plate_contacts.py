"""Contact intervals on the plates, and the whole steps between them."""

import numpy as np

from stridelab.conventions import Series, Vector3
from stridelab.recordings.gap_filling import true_runs
from stridelab.recordings.recording import Plate, Recording, Remark, Window

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
