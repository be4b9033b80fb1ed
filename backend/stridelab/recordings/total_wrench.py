"""Total contact wrench (2.5) at the marker instants: zero-phase low-pass, then interpolation."""

import numpy as np
from jaxtyping import Float
from scipy.linalg.lapack import dtbtrs

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
    return filter_both_ways(track, rate_hz, LOW_PASS_HZ, 9)


def filter_both_ways(
    track: Float[np.ndarray, "n *axes"], rate_hz: float, band_hz: float, pad: int
) -> Float[np.ndarray, "n *axes"]:
    """Second-order Butterworth low-pass, forward and backward, of a track continued oddly by ``pad`` samples.

    ``sosfiltfilt(butter(2, band_hz, fs=rate_hz, output="sos"), track, axis=0, padlen=pad)`` of ``scipy.signal``, whose
    import takes longer than the estimation of a walk. The pass y = x_0 + H (x - x_0) starts at rest, since H(1) = 1.
    """
    k = np.tan(np.pi * band_hz / rate_hz)
    a = np.array([1.0 + np.sqrt(2.0) * k + k**2, 2.0 * (k**2 - 1.0), 1.0 - np.sqrt(2.0) * k + k**2])
    x = track.reshape(len(track), -1)
    x = np.concatenate([2.0 * x[0] - x[pad:0:-1], x, 2.0 * x[-1] - x[-2 : -pad - 2 : -1]])
    recursion = np.repeat((a / a[0])[:, None], len(x), axis=1)
    for _ in range(2):
        inner = x - x[0]
        inner[2:] += 2.0 * inner[1:-1] + inner[:-2]
        inner[1] += 2.0 * inner[0]
        x = (x[0] + dtbtrs(recursion, k**2 / a[0] * inner, uplo="L")[0])[::-1]
    return np.asarray(x[pad : len(x) - pad].reshape(track.shape))
