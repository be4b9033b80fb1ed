"""Finds the times at which a force plate is overloaded: one of its channels stays at its limit.

A channel at its limit repeats one value, its largest or its smallest, until the load is back in its range. Within the
range, noise and motion change the value from sample to sample. A run of n equal samples at an extreme of a channel,
while the plate is loaded, is at the limit if

    n >= max(n_min, 4 n_inner)    and    n_near <= max(2, n / 10),

with n_inner the longest run of equal samples at any other value, and n_near the number of samples within three digits
of the extreme among the n before and the n after the run. A signal of coarse digits has long runs at all values, and
approaches its peak slowly: at the peak of a parabola n_near is n. If the file states the bits of its
converter, two samples at the end of their range suffice.

A channel that was filtered, or mixed with others, after it was limited repeats no value: its limit cannot be found.
"""

from collections.abc import Sequence
from typing import Final

import numpy as np
from jaxtyping import Int

from stridelab.conventions import Mask, Series
from stridelab.recordings.files.raw import Channels, FilePlate, Ranges
from stridelab.recordings.gap_filling import true_runs
from stridelab.recordings.recording import Plate, Recording, Remark

FORCE_CLIPPED: Final = "force-clipped"
"""Code of the remark on an overloaded plate."""
_MIN_RUN, _MIN_RUN_S, _TIMES_LONGER = 4, 0.004, 4
_MIN_RUN_OF_CONVERTER: Final = 2
_MIN_VALUES: Final = 20
"""Fewest distinct values of a loaded channel: one that has fewer is not connected, or made up."""
_NEAR_DIGITS, _NEAR_SHARE, _MIN_NEAR = 3.5, 0.1, 2
_ROUNDING: Final = 1e-6
"""Smaller differences of values, over the largest value, are rounding errors."""
MARGIN_S: Final = 0.02
"""The low-pass of the force spreads what is wrong by this time."""

Intervals = tuple[tuple[float, float], ...]


def clipped_intervals_s(channels: Channels, loaded: Mask, rate_hz: float, ranges: Ranges | None = None) -> Intervals:
    """First and last instants in seconds at which a channel stays at its limit while the plate is ``loaded``.

    ``ranges`` has the smallest and the largest value of the converter for each channel, NaN where they are unknown.
    """
    clipped = np.zeros(len(loaded), dtype=bool)
    for k, values in enumerate(channels.T):
        limits = () if ranges is None else tuple(float(limit) for limit in ranges[k])
        clipped |= _samples_at_limit(values, loaded, max(_MIN_RUN, round(_MIN_RUN_S * rate_hz)), limits)
    return tuple((i / rate_hz, (j - 1) / rate_hz) for i, j in true_runs(clipped))


def _samples_at_limit(values: Series, loaded: Mask, min_run: int, limits: Sequence[float]) -> Mask:
    """Samples of one channel in runs of equal values at its limit; 0 is the value of an empty plate and no limit."""
    at_limit = np.zeros(len(values), dtype=bool)
    levels = np.unique(values[loaded])
    if len(levels) < _MIN_VALUES:
        return at_limit
    steps = np.diff(levels)
    digit = float(steps[steps > _ROUNDING * np.abs(levels).max()].min(initial=np.inf))
    starts, ends = _equal_runs(values)
    n_loaded = np.diff(np.concatenate([[0], np.cumsum(loaded)])[np.append(starts, len(values))])
    lengths, extremes = ends - starts, [end for end in (values.min(), values.max()) if end != 0.0]
    inner = n_loaded[~np.isin(values[starts], [0.0, *extremes])].max(initial=0)
    for extreme in extremes:
        is_limit = any(abs(extreme - limit) < 0.5 * digit for limit in limits)
        needed = _MIN_RUN_OF_CONVERTER if is_limit else max(min_run, _TIMES_LONGER * int(inner))
        for k in np.flatnonzero((values[starts] == extreme) & (lengths == n_loaded) & (lengths >= needed)):
            i, j, n = int(starts[k]), int(ends[k]), int(lengths[k])
            beside = np.concatenate([values[max(0, i - n) : i], values[j : j + n]])
            apart = np.abs(beside - extreme)
            n_near = np.count_nonzero((apart > 0.0) & (apart < _NEAR_DIGITS * digit))
            at_limit[i:j] = is_limit or n_near <= max(_MIN_NEAR, _NEAR_SHARE * n)
    return at_limit


def _equal_runs(values: Series) -> tuple[Int[np.ndarray, " runs"], Int[np.ndarray, " runs"]]:
    """First samples of the runs of equal values, and the samples after their last ones."""
    edges = np.flatnonzero(np.diff(values)) + 1
    return np.append(0, edges), np.append(edges, len(values))


def clipped_remark(plate: FilePlate) -> Remark:
    """Remark on a plate that is overloaded."""
    spans: list[list[float]] = []
    for start_s, end_s in plate.clipped_s:
        if spans and start_s - spans[-1][1] <= 2.0 * MARGIN_S:
            spans[-1][1] = end_s
        else:
            spans.append([start_s, end_s])
    when = ", ".join(f"{start_s:.2f} to {end_s:.2f} s" for start_s, end_s in spans)
    message = (
        f"Plate {plate.index} is overloaded at {when}: one of its channels stays at its limit and does not follow the "
        "load. These times are not used."
    )
    return Remark(FORCE_CLIPPED, message)


def clipped_frames(recording: Recording) -> Mask:
    """Frames at which a plate in use is overloaded, and those within ``MARGIN_S`` of them."""
    clipped = np.zeros(recording.n_frames, dtype=bool)
    for plate in recording.plates:
        for start_s, end_s in plate.clipped_s if plate.use else ():
            clipped |= (recording.time_s >= start_s - MARGIN_S) & (recording.time_s <= end_s + MARGIN_S)
    return clipped


def clipped_share(plate: Plate, rate_hz: float) -> float:
    """Share of the plate's loaded time at which it is overloaded."""
    clipped = sum(end_s - start_s + 1.0 / rate_hz for start_s, end_s in plate.clipped_s)
    return clipped * rate_hz / max(int(np.count_nonzero(plate.loaded)), 1)
