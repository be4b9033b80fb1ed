"""Total contact wrench (2.5) at the marker instants: zero-phase low-pass, then interpolation."""

import numpy as np
from scipy.signal import butter, sosfiltfilt

from stridelab.conventions import Points
from stridelab.recordings.recording import Recording, Window, WrenchTrack

LOW_PASS_HZ = 50.0
"""Second order, forward and backward; passes gait (below 20 Hz) and removes plate ringing."""


def wrench_track(recording: Recording, windows: tuple[Window, ...], *, latency_s: float = 0.0) -> WrenchTrack:
    """Sum of the plates in use, sampled *at* the marker instants.

    ``latency_s`` > 0 is the delay of the force, which is then read that much later. ``complete`` marks the frames
    inside a window; with a latency, frames read beyond the recorded force are not complete. Filtering and interpolation
    are used because block means would shift the force by half a block (4.7 ms at 1500 to 100 Hz).
    """
    time_s = recording.time_s
    complete = np.zeros(len(time_s), dtype=bool)
    for window in windows:
        complete |= (time_s >= window.start_s - 1e-9) & (time_s <= window.end_s + 1e-9)
    used = [plate for plate in recording.plates if plate.use]
    if not used:
        nothing = np.zeros((len(time_s), 3))
        return WrenchTrack(time_s, nothing, nothing.copy(), np.zeros_like(complete), windows, latency_s)
    n = len(used[0].force_n)
    read_at_s = time_s + latency_s
    force_time_s = np.arange(n) / recording.force_rate_hz
    complete &= (read_at_s >= 0.0) & (read_at_s <= force_time_s[-1])
    tracks = []
    for total in (
        np.sum([plate.force_n for plate in used], axis=0),
        np.sum([plate.moment_nm for plate in used], axis=0),
    ):
        smooth = low_pass(total, recording.force_rate_hz)
        tracks.append(np.column_stack([np.interp(read_at_s, force_time_s, smooth[:, j]) for j in range(3)]))
    return WrenchTrack(time_s, tracks[0], tracks[1], complete, windows, latency_s)


def low_pass(track: Points, rate_hz: float) -> Points:
    """Zero-phase Butterworth low-pass at ``LOW_PASS_HZ``; too short or too slowly sampled tracks are unchanged."""
    if rate_hz <= 2.5 * LOW_PASS_HZ or len(track) <= 16:
        return track
    return np.asarray(sosfiltfilt(butter(2, LOW_PASS_HZ, fs=rate_hz, output="sos"), track, axis=0))
