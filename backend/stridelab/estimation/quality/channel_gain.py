"""Gain of the plates' force channels, from the motion of the markers: finds a scaled, reversed or dead channel.

The markers need the force m (c'' - g), the plates measure f. Per axis of the walk and per plate i, regression of the
one on the other,

    m (c'' - g) = sum_i b_i f_i + const            (6 Hz band),

gives b_i = 1 for channels that measure what moves the body, 2 for one that reads half, -1 for a reversed one. Along and
across the walk the balance of moments (``force_balance``) gives the same force in another way, and a second gain h_i.
The two have different errors and are combined by their variances; where they differ by more than these, the variance
grows with chi-squared. Without segments, the position gives a second gain k_i instead,

    c = sum_i k_i (1/m) int int f_i + c_0 + v_0 t + a t^2,

and the one of b and k that is nearer to 1 counts: soft tissue shakes the acceleration, and the position drifts.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Bool, Float

from stridelab.conventions import GRAVITY_M_S2
from stridelab.estimation.quality.plate_checks import ForceBalance

MIN_VARIATION: Final = (0.015, 0.015, 0.05)
"""Standard deviation of a channel over the weight, along, across and vertically, below which it is not judged."""
MAX_SD: Final = 0.4
"""Largest standard error, over the gain if that is more than 1, of a gain that is judged."""
MODEL_SD: Final = (0.05, 0.1)
"""Standard errors that regressions do not show, over the gain: of the acceleration, and of the segments' momentum."""
DEAD_SHARE: Final = 0.2
"""A force that varies by less than this share of what the motion of a walk needs is dead or mostly so."""
DEAD_PLATE_SHARE: Final = 0.1
"""The same for one plate while it carries the body alone."""
EXPLAINED_SHARE: Final = 0.5
"""Largest share of the needed force that exchanged channels may leave unexplained to count as an explanation."""
EXPLAINED_VARIANCE: Final = 0.5
"""Share of the variance of the needed lateral force that a gain must explain, else errors of the markers are larger."""
MIN_CARRIED: Final = 0.15
"""Standard deviation of a plate's vertical force over the weight, below which its lateral channel is not judged."""
_DEAD_NEEDS: Final = 0.04
_DEAD_PLATE_NEEDS: Final = (0.03, 0.02)
_ALONE: Final = 0.85
_ALONE_S: Final = 0.15
_CARRIES: Final = 0.4
_SD: Final = 2.0
_ALL: Final = 0
_ALONG, _ACROSS, _VERTICAL = 0, 1, 2
_AXES: Final = ("along the walk", "across the walk", "vertically")

Needed = Float[np.ndarray, " frames"]
Tracks = Float[np.ndarray, "plates frames"]
Gains = Float[np.ndarray, " judged"]
Judged = Bool[np.ndarray, " plates"]


@dataclass(frozen=True)
class ChannelGain:
    """Force that the markers need over the force that ``plate`` measures on ``axis``; plate 0 is all of them together.

    ``sd`` is its standard error. A dead channel has an infinite gain.
    """

    axis: str
    plate: int
    gain: float
    sd: float

    @property
    def deviation(self) -> float:
        """Distance from 1 of the nearest gain within two standard errors; 1 if half or twice the force is measured."""
        if math.isinf(self.gain):
            return 1.0
        low, high = self.gain - _SD * self.sd, self.gain + _SD * self.sd
        return _distance_from_one(min(max(1.0, low), high))


def channel_gains(balance: ForceBalance | None) -> tuple[ChannelGain, ...]:
    """Gains of all channels that vary enough."""
    if balance is None:
        return ()
    # feet side by side push apart, so that only in a walk, where one foot carries at a time, a plate is judged alone
    alone = ((_ALONG, False), (_ACROSS, False)) if balance.is_walk else ()
    gains: list[ChannelGain] = []
    for axis, together in (*alone, (_ALONG, True), (_ACROSS, True), (_VERTICAL, False), (_VERTICAL, True)):
        gains += _gains_on_axis(balance, axis, together=together)
    return (*gains, *_dead_plates(balance))


def exchange_ratio(balance: ForceBalance | None) -> float:
    """Unexplained force with the horizontal channels as they are, over that with them exchanged; NaN if not a walk.

    Above 1 the motion is explained better by the force along the walk taken as the one across it, and the reverse. All
    plates' channels, or those of one plate, are exchanged, with either sign, and the best of these is compared; 0 if
    it leaves more than half of the needed force unexplained.
    """
    if balance is None or balance.moment_needed_n is None or not balance.is_walk:
        return math.nan
    needed_n = balance.moment_needed_n
    if needed_n[:, _ALONG].std() < _DEAD_NEEDS * balance.weight_n:
        return math.nan
    least_n = MIN_VARIATION[_VERTICAL] * balance.weight_n
    loaded = [k for k, track in enumerate(balance.banded_n) if track[:, _VERTICAL].std() > least_n]
    choices = [loaded, *([k] for k in loaded if len(loaded) > 1)]
    best = min(_unexplained_share(balance, exchanged) for exchanged in choices)
    if best > EXPLAINED_SHARE * float(np.sqrt(needed_n.var(axis=0).sum())):
        return 0.0
    return _unexplained_share(balance, ()) / best if best > 0.0 else math.inf


def _unexplained_share(balance: ForceBalance, exchanged: list[int] | tuple[()]) -> float:
    """Standard deviation of the needed horizontal force minus the measured one, best sign of the exchanged channels."""
    assert balance.moment_needed_n is not None
    kept = [k for k in range(len(balance.plates)) if k not in exchanged]
    rest = balance.moment_needed_n - balance.levered_n[kept].sum(axis=0)
    crossed = balance.crossed_n[list(exchanged)].sum(axis=0)
    variances = [(rest + sign * crossed).var(axis=0) for sign in (1.0, -1.0)]
    return float(np.sqrt(np.sum(np.min(variances, axis=0))))


def _gains_on_axis(balance: ForceBalance, axis: int, *, together: bool) -> Iterator[ChannelGain]:
    """Gains of each plate on one axis, or of all plates together."""
    horizontal = axis != _VERTICAL
    tracks_n, banded_n = balance.force_n[:, :, axis], balance.banded_n[:, :, axis]
    names = [plate.index for plate in balance.plates]
    levered_n = balance.levered_n[:, :, axis] if horizontal else banded_n
    if together:
        tracks_n, banded_n, levered_n = (x.sum(axis=0)[None] for x in (tracks_n, banded_n, levered_n))
        names = [_ALL]
    needed_n = balance.needed_n[:, axis]
    moment_n = None if balance.moment_needed_n is None or not horizontal else balance.moment_needed_n[:, axis]
    least_n = MIN_VARIATION[axis] * balance.weight_n
    lateral_alone = axis == _ACROSS and not together
    if lateral_alone and (moment_n is None or not balance.trunk_is_marked or not balance.is_straight):
        return
    if (together or lateral_alone) and moment_n is not None and moment_n.std() > least_n:
        least_n *= DEAD_SHARE
    judged = banded_n.std(axis=1) > least_n
    if lateral_alone:
        judged &= balance.banded_n[:, :, _VERTICAL].std(axis=1) > MIN_CARRIED * balance.weight_n
    if together and horizontal and balance.is_walk:
        needs, measured = (float(x.std()) for x in (needed_n if moment_n is None else moment_n, banded_n))
        if needs > _DEAD_NEEDS * balance.weight_n and measured < DEAD_SHARE * needs:
            yield ChannelGain(_AXES[axis], _ALL, math.inf, 0.0)
    if not judged.any():
        return
    b, sd = _fit_gains(needed_n, banded_n, judged, balance.n_free)
    if moment_n is not None:
        h, h_sd = _fit_gains(moment_n, levered_n, judged, balance.n_free)
        gain, sd = _combine_gains((b, h), (sd, h_sd))
        if axis == _ACROSS and _explained_share(moment_n, levered_n, judged, gain) < EXPLAINED_VARIANCE:
            return
    elif horizontal:
        k = _position_gains(balance.position_m[:, axis], balance, tracks_n, judged)
        gain = np.array([min(pair, key=_distance_from_one) for pair in zip(b, k, strict=True)])
    else:
        gain = b
    for n, here in enumerate(np.flatnonzero(judged)):
        if sd[n] <= MAX_SD * max(1.0, abs(gain[n])):
            yield ChannelGain(_AXES[axis], names[here], float(gain[n]), float(sd[n]))


def _explained_share(needed_n: Needed, tracks_n: Tracks, judged: Judged, gain: Gains) -> float:
    """Share of the variance of the needed force that the tracks explain, those that are judged times their gains."""
    gains = np.ones(len(tracks_n))
    gains[judged] = gain
    return 1.0 - float((needed_n - gains @ tracks_n).var() / needed_n.var())


def _combine_gains(gains: tuple[Gains, Gains], sds: tuple[Gains, Gains]) -> tuple[Gains, Gains]:
    """Mean of two gains by their variances; its standard error, larger where they differ by more than that."""
    variances = [sd**2 + (model * gain) ** 2 for gain, sd, model in zip(gains, sds, MODEL_SD, strict=True)]
    weights = [1.0 / np.maximum(variance, 1e-12) for variance in variances]
    mean = (weights[0] * gains[0] + weights[1] * gains[1]) / (weights[0] + weights[1])
    chi_squared = (gains[0] - gains[1]) ** 2 / np.maximum(variances[0] + variances[1], 1e-12)
    return mean, np.sqrt(np.maximum(1.0, chi_squared) / (weights[0] + weights[1]))


def _dead_plates(balance: ForceBalance) -> Iterator[ChannelGain]:
    """Horizontal channels of single plates that measure next to nothing while their plate carries the body alone."""
    if balance.moment_needed_n is None or not balance.is_walk:
        return
    upward_n = balance.banded_n[:, :, _VERTICAL]
    load_n = upward_n.sum(axis=0)
    for plate, track, force_n in zip(balance.plates, balance.levered_n, upward_n, strict=True):
        alone = (force_n > _ALONE * load_n) & (load_n > _CARRIES * balance.weight_n)
        if np.count_nonzero(alone) < _ALONE_S * balance.rate_hz:
            continue
        for axis, size in ((_ALONG, np.std), (_ACROSS, _root_mean_square)):
            needs, measured = size(balance.moment_needed_n[alone, axis]), size(track[alone, axis])
            if needs > _DEAD_PLATE_NEEDS[axis] * balance.weight_n and measured < DEAD_PLATE_SHARE * needs:
                yield ChannelGain(_AXES[axis], plate.index, math.inf, 0.0)


def _root_mean_square(x: Needed) -> float:
    return float(np.sqrt(np.mean(x**2)))


def _fit_gains(needed_n: Needed, tracks_n: Tracks, judged: Judged, n_free: float) -> tuple[Gains, Gains]:
    """Slopes of the needed force on each judged track, and their standard errors for ``n_free`` independent samples.

    The tracks that vary too little are taken as they are.
    """
    A = np.column_stack([*tracks_n[judged], np.ones(tracks_n.shape[1])])
    y = needed_n - tracks_n[~judged].sum(axis=0)
    solution = np.linalg.lstsq(A, y, rcond=None)[0]
    variance = float(np.sum((y - A @ solution) ** 2)) / max(1.0, n_free - A.shape[1])
    sd = np.sqrt(np.diag(np.linalg.pinv(A.T @ A)) * variance)
    return solution[:-1], sd[:-1]


def _position_gains(position_m: Needed, balance: ForceBalance, tracks_n: Tracks, judged: Judged) -> Gains:
    """Gains for which the twice integrated tracks explain the position; its drift (a parabola) is free."""
    double = tracks_n * GRAVITY_M_S2 / balance.weight_n
    for _ in range(2):
        steps = 0.5 * (double[:, 1:] + double[:, :-1]) / balance.rate_hz
        double = np.concatenate([np.zeros((len(double), 1)), np.cumsum(steps, axis=1)], axis=1)
    t = np.linspace(0.0, 1.0, len(position_m))
    A = np.column_stack([*double[judged], np.ones_like(t), t, t**2])
    y = position_m - double[~judged].sum(axis=0)
    return np.asarray(np.linalg.lstsq(A, y, rcond=None)[0][: int(judged.sum())])


def _distance_from_one(gain: float) -> float:
    """Distance of a gain from 1: the same for a gain and its inverse, up to 2; larger below one half."""
    if gain >= 1.0:
        return gain - 1.0
    return 1.0 / gain - 1.0 if gain > 0.5 else 2.0 * (1.0 - gain)
