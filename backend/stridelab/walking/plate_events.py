r"""Strikes and lift-offs of the contacts on a plate, each with the standard deviation of its time.

A contact is loaded above the plate's threshold h (20 N). Near its ends the load is the component L of the force along
the mean force of its first (last) 40 ms, so that the noise of the empty plate scatters it without a bias, which the
size of the force has. With sigma the noise of L, T the sampling interval and s the slope of the load, the mean of n
samples crosses h at the time of their middle. Its deviation is

    sd^2 = (sigma_n / s)^2 + d^2 / 3,    n = (6 sigma / (s T))^(2/3), at least 1, over at most 1.6 h of load.

sigma_n is the scatter of means of n samples of the empty plate, its offset included: white noise has sigma / sqrt(n).
The mean of more samples scatters less but bends with the load, hence n. With n = 1 a line joins the samples before
and after the crossing, at the share a of their interval: sigma_1 = sigma sqrt(a^2 + (1 - a)^2). Within that
interval the load may be a line, or zero and then the line through the next samples; d is the time between their
crossings beyond what noise explains. It vanishes with T.

An empty plate whose stored force is exactly zero does not show its noise, nor does one that is never empty. There sigma
is the median size of third differences of the loaded plate, and sigma_n = sigma / sqrt(n). Impacts do not enter it.

Some laboratories store plates with a dead band: the Rehazenter files contain no force below 50 N. There the load begins
before the first and ends after the last stored sample; linear extrapolation of the nearest samples gives the instant of
zero load: 10 ms earlier and 11 ms later at normal pace (C4). A force that was low-passed before it was stored begins to
rise before the foot strikes; the strike follows from the load above 50 N and the strength of the filter
(``low_passed_plates``).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from jaxtyping import Float

from stridelab.conventions import Points, Series, Vector3
from stridelab.recordings.gap_filling import true_runs
from stridelab.recordings.plate_contacts import empty_samples, loaded_intervals
from stridelab.recordings.recording import Plate
from stridelab.walking.low_passed_plates import FILTERED_LOAD_N, LEAD_SD_S, low_pass_lead_s

DEAD_BAND: Final = 1.5
"""A contact is cut by a dead band if its first (last) sample exceeds this multiple of the threshold."""
QUIET_SHARE: Final = 0.25
"""Load inside a dead band, over the threshold: above it the load rises or falls steeply, and nothing is cut off."""
RISE_S, FALL_S = 0.005, 0.01
"""Durations of the linear fits: a heel loads faster than toes unload."""
MAX_BEFORE_S, MAX_AFTER_S = 0.02, 0.03
DIRECTION_S: Final = 0.04
"""Duration of the contact whose mean force is the direction of the load."""
BEFORE_S, BEHIND_S = 0.03, 0.06
"""Times before and after the first loaded sample between which the crossing is searched."""
WIDENING: Final = 6.0
"""Samples of a mean, to the power 3/2, over noise per rise of the load from sample to sample."""
MOST_RISE: Final = 1.6
"""Largest rise of the load within the samples of a mean, over the threshold."""
FIRST_NOISE: Final = 0.15
"""Noise over the threshold that remains in the means from which the slope is first taken."""
NOISE_REACH: Final = 4.0
"""Standard deviations of noise that a sample may be off: where they reach the threshold, no dead band is seen."""
NORMAL_MEDIAN: Final = 0.6745
"""Median size of normal noise over its standard deviation."""
MIN_DIFFERENCED: Final = 20
"""Samples of a contact below which its third differences say nothing."""
LEAST_SHARE: Final = 0.02
"""Least deviation of a crossing, over the sampling interval."""
UNKNOWN_SD_S: Final = 0.002
"""Deviation of the time of a load that does not cross the threshold near its first sample."""


@dataclass(frozen=True)
class PlateEvent:
    """Time of a strike or lift-off on the force's clock, and the standard deviation of its error."""

    at_s: float
    sd_s: float


@dataclass(frozen=True)
class PlateNoise:
    """Noise of a plate: its stretches without load, or a third difference of its load where they do not show it."""

    empty_n: Sequence[Float[np.ndarray, "_ 3"]]
    loaded_n: Float[np.ndarray, "_ 3"]
    _moments: dict[int, Float[np.ndarray, "3 3"]] = field(default_factory=dict)

    def scatter_n(self, direction: Vector3, n: int) -> float:
        """Root mean square of the mean of ``n`` successive samples along ``direction``, without any load."""
        if n not in self._moments:
            self._moments[n] = self._moment_of_means(n)
        return math.sqrt(max(float(direction @ self._moments[n] @ direction), 0.0))

    def _moment_of_means(self, n: int) -> Float[np.ndarray, "3 3"]:
        sums = [np.cumsum(np.vstack([np.zeros(3), stretch]), axis=0) for stretch in self.empty_n if len(stretch) >= n]
        means = np.concatenate([(total[n:] - total[:-n]) / n for total in sums]) if sums else np.zeros((0, 3))
        if len(means) and means.any():
            return np.asarray(means.T @ means / len(means))
        if len(self.loaded_n) < MIN_DIFFERENCED:
            return np.zeros((3, 3))
        third = np.median(np.abs(np.diff(self.loaded_n, n=3, axis=0)), axis=0) / NORMAL_MEDIAN
        return np.asarray(np.diag(third**2) / 20.0 / n)  # 1 + 9 + 9 + 1


def plate_noise(plate: Plate, rate_hz: float) -> PlateNoise:
    """Noise of ``plate`` from its samples without load, and of its longest contact."""
    empty = [plate.force_n[i:j] for i, j in true_runs(empty_samples(plate, rate_hz))]
    contacts = loaded_intervals(plate, rate_hz)
    start_s, end_s = max(contacts, key=lambda span: span[1] - span[0], default=(0.0, 0.0))
    return PlateNoise(empty, plate.force_n[round(start_s * rate_hz) : round(end_s * rate_hz)])


def contact_intervals(plate: Plate, rate_hz: float) -> list[tuple[float | None, float | None]]:
    """Start and end of each contact in seconds of the force's clock; None if cut off by the recording."""
    return [
        (None if begins is None else begins.at_s, None if ends is None else ends.at_s)
        for begins, ends in plate_events(plate, rate_hz)
    ]


def plate_events(plate: Plate, rate_hz: float) -> list[tuple[PlateEvent | None, PlateEvent | None]]:
    """Strike and lift-off of each contact; None if cut off by the recording."""
    force, noise = plate.force_n, plate_noise(plate, rate_hz)
    load = np.linalg.norm(force, axis=1)
    lead_s = low_pass_lead_s(plate, rate_hz)
    last = len(load) - 1
    events: list[tuple[PlateEvent | None, PlateEvent | None]] = []
    for start_s, end_s in loaded_intervals(plate, rate_hz):
        i, j = round(start_s * rate_hz), round(end_s * rate_hz)
        begins = ends = None
        if i > 0 and lead_s is not None:
            begins = _low_passed_strike(load, i, rate_hz, lead_s)
        elif i > 0:
            begins = _load_onset(force, i, plate.threshold_n, rate_hz, noise, (RISE_S, MAX_BEFORE_S))
        if j < last:
            back = _load_onset(force[::-1], last - j, plate.threshold_n, rate_hz, noise, (FALL_S, MAX_AFTER_S))
            ends = PlateEvent(last / rate_hz - back.at_s, back.sd_s)
        events.append((begins, ends))
    return events


def _low_passed_strike(load: Series, first: int, rate_hz: float, lead_s: float) -> PlateEvent:
    k = first + int(np.argmax(load[first:] > FILTERED_LOAD_N))
    zero_s = k / rate_hz - _beyond_s(load[k:], 0.0, rate_hz, RISE_S, MAX_BEFORE_S)
    return PlateEvent(zero_s + lead_s, LEAD_SD_S)


def _load_onset(
    force: Points,
    first: int,
    threshold_n: float,
    rate_hz: float,
    noise: PlateNoise,
    extrapolation_s: tuple[float, float],
) -> PlateEvent:
    """Time of the load whose first sample above the threshold is ``first``, in the order of the samples.

    ``extrapolation_s``: duration of the line behind a dead band, and the most that it extrapolates.
    """
    toward = force[first : first + max(3, round(DIRECTION_S * rate_hz))].mean(axis=0)
    toward = toward / np.linalg.norm(toward)
    load = np.linalg.norm(force[first - 1 :], axis=1)
    is_quiet = NOISE_REACH * noise.scatter_n(toward, 1) < threshold_n
    if is_quiet and load[0] < QUIET_SHARE * threshold_n:
        beyond_s = _beyond_s(load[1:], threshold_n, rate_hz, *extrapolation_s)
        if beyond_s > 0.0:
            return PlateEvent(first / rate_hz - beyond_s, beyond_s / math.sqrt(3.0))
    begin = max(0, first - round(BEFORE_S * rate_hz))
    along = force[begin : first + round(BEHIND_S * rate_hz)] @ toward
    crossing = _threshold_crossing(along, first - begin - 0.5, threshold_n, noise, toward)
    if crossing is None:
        return PlateEvent(first / rate_hz, UNKNOWN_SD_S)
    return PlateEvent((begin + crossing[0]) / rate_hz, max(crossing[1], LEAST_SHARE) / rate_hz)


def _threshold_crossing(
    load: Series, near: float, threshold_n: float, noise: PlateNoise, toward: Vector3
) -> tuple[float, float] | None:
    """Crossing of the threshold nearest to ``near`` and its deviation, in samples; None if there is none."""
    sigma_n = noise.scatter_n(toward, 1)
    n = min(max(1, math.ceil((sigma_n / (FIRST_NOISE * threshold_n)) ** 2)), max(1, len(load) // 3))
    rough = _MeanCrossing.find_nearest(load, n, near, threshold_n)
    if rough is None:
        return None
    doubled = np.flatnonzero(rough.means[rough.after :] >= 2.0 * threshold_n)
    later = rough.after + (int(doubled[0]) if len(doubled) else len(rough.means) - rough.after) + rough.compute_lag()
    rise_n = threshold_n / max(later - rough.locate_instant(), 0.5)
    most = max(1, int(MOST_RISE * threshold_n / rise_n))
    n = min(max(1, round((WIDENING * sigma_n / rise_n) ** (2.0 / 3.0))), most)
    found = _MeanCrossing.find_nearest(load, n, rough.locate_instant(), threshold_n) or rough
    rise_n = max(found.mean_rise_n(), 0.3 * rise_n)
    if found.n > 1:
        return found.locate_instant(), noise.scatter_n(toward, found.n) / rise_n
    share = found.share
    return found.locate_instant(), math.hypot(
        sigma_n * math.hypot(share, 1.0 - share) / rise_n, found.estimate_bend(threshold_n, sigma_n)
    )


@dataclass(frozen=True)
class _MeanCrossing:
    """The instant at which the mean of ``n`` samples rises through the threshold, in samples.

    ``after`` is the first of ``means`` above it, and ``share`` that of the interval before it which lies below.
    """

    n: int
    means: Series
    after: int
    share: float

    @classmethod
    def find_nearest(cls, load: Series, n: int, near: float, threshold_n: float) -> "_MeanCrossing | None":
        """The crossing nearest to the instant ``near``."""
        if len(load) <= n:
            return None
        means = np.convolve(load, np.full(n, 1.0 / n), "valid")
        rises = np.flatnonzero((means[1:] >= threshold_n) & (means[:-1] < threshold_n)) + 1
        if len(rises) == 0:
            return None
        after = int(rises[np.argmin(np.abs(rises - 0.5 + 0.5 * (n - 1) - near))])
        share = (threshold_n - means[after - 1]) / (means[after] - means[after - 1])
        return cls(n, means, after, float(share))

    def compute_lag(self) -> float:
        """From the first of the samples of a mean to their middle."""
        return 0.5 * (self.n - 1)

    def locate_instant(self) -> float:
        """The instant of the crossing."""
        return self.after - 1 + self.share + self.compute_lag()

    def mean_rise_n(self) -> float:
        """Rise of the means per sample, over twice the samples of a mean."""
        width = max(self.n, 2)
        middle = self.locate_instant() - self.compute_lag()
        ends = np.interp([middle - width, middle + width], np.arange(len(self.means)), self.means)
        return float(ends[1] - ends[0]) / (2 * width)

    def estimate_bend(self, threshold_n: float, sigma_n: float) -> float:
        """Deviation of the crossing of a load that may be bent between the two samples around it, in samples."""
        before_n, after_n = self.means[self.after - 1], self.means[self.after]
        following = self.means[min(self.after + 1, len(self.means) - 1)] - after_n
        above_n = after_n - threshold_n
        late = 1.0 - above_n / max(following, above_n, 1e-9) - self.share
        of_noise = math.sqrt(6.0) * (1.0 - self.share) * sigma_n / (after_n - before_n)
        return math.sqrt(max(late**2 - of_noise**2, 0.0) / 3.0)


def _beyond_s(load: np.ndarray, threshold_n: float, rate_hz: float, stretch_s: float, most_s: float) -> float:
    """Time before the first sample of ``load`` at which it was zero; 0 without a dead band."""
    if load[0] < DEAD_BAND * threshold_n:
        return 0.0
    n = min(max(3, round(stretch_s * rate_hz)), len(load))
    slope, at_start = np.polyfit(np.arange(n) / rate_hz, load[:n], 1)
    return float(min(max(at_start / slope, 0.0), most_s)) if slope > 0.0 else most_s
