"""Gain of the plates' force channels, from the motion of the markers: finds a scaled, reversed or dead channel.

The markers need the force m (c'' - g), the plates measure f. Per axis of the walk and per plate i, regression of the
one on the other,

    m (c'' - g) = sum_i b_i f_i + const            (6 Hz band),
    c = sum_i k_i (1/m) int int f_i + c_0 + v_0 t + a t^2,

gives b_i = k_i = 1 for channels that measure what moves the body, 2 for one that reads half, -1 for a reversed one.
Horizontally a gain counts as far from 1 as the nearer of both: soft tissue shakes the acceleration, and the position
drifts. Vertically the acceleration is much larger than either, and b counts.
"""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Bool, Float

from stridelab.body.geometric_com import GeometricCom
from stridelab.conventions import GRAVITY_M_S2, Series
from stridelab.dynamics.wrench import contact_force
from stridelab.estimation.differentiation import low_pass, smoothed_derivatives, walk_frame
from stridelab.estimation.evaluation.physics_residuals import MOMENTUM_BAND_HZ
from stridelab.recordings.gap_filling import true_runs
from stridelab.recordings.plate_contacts import low_pass as low_pass_force
from stridelab.recordings.recording import Recording, WrenchTrack

MIN_TIME_S: Final = 0.4
"""Shortest time, beside the filter's transients, for a regression: five independent samples in the band."""
MIN_VARIATION: Final = (0.015, 0.015, 0.05)
"""Standard deviation of a channel over the weight, along, across and vertically, below which it is not judged."""
MAX_SD: Final = 0.4
"""Largest standard error, over the gain if that is more than 1, of a gain that is judged."""
DEAD_SHARE: Final = 0.2
"""A force that varies by less than this share of what the motion of a walk needs is dead or mostly so."""
_DEAD_NEEDS: Final = 0.04
_WALK_M_S: Final = 0.5
_EDGE: Final = 0.6
_SD: Final = 2.0
_ALL: Final = 0
_ALONG, _ACROSS, _VERTICAL = 0, 1, 2
_AXES: Final = ("along the walk", "across the walk", "vertically")

Tracks = Float[np.ndarray, "plates frames"]
Gains = Float[np.ndarray, " judged"]


@dataclass(frozen=True)
class ChannelGain:
    """Force that the markers need over the force that ``plate`` measures on ``axis``; plate 0 is all of them together.

    ``sd`` is the standard error of the regression. A dead channel has an infinite gain.
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


def channel_gains(
    recording: Recording, geometric: GeometricCom, wrench: WrenchTrack, mass_kg: float
) -> tuple[ChannelGain, ...]:
    """Gains of all channels that vary enough, over the longest stretch with all force and geometry."""
    known = wrench.complete & np.isfinite(wrench.force_n).all(axis=1) & np.isfinite(geometric.com_m).all(axis=1)
    plates = [plate for plate in recording.plates if plate.use]
    if not known.any() or not plates:
        return ()
    i, j = max(true_runs(known), key=lambda run: run[1] - run[0])
    rate_hz = (len(wrench.time_s) - 1) / (wrench.time_s[-1] - wrench.time_s[0])
    edge = int(np.ceil(_EDGE * rate_hz / MOMENTUM_BAND_HZ))
    if j - i < 2 * edge + MIN_TIME_S * rate_hz:
        return ()
    velocity, acceleration = smoothed_derivatives(geometric.com_m[i:j], rate_hz, MOMENTUM_BAND_HZ)
    velocity = velocity - geometric.ground_m_s
    frame, weight_n = walk_frame(velocity), mass_kg * GRAVITY_M_S2
    is_walk = float(np.linalg.norm(np.mean(velocity[:, :2], axis=0))) > _WALK_M_S
    needed_n = contact_force(acceleration, mass_kg) @ frame.T
    position_m = geometric.com_m[i:j] @ frame.T
    read_at_s = wrench.time_s[i:j] + wrench.latency_applied_s
    force_n = np.array([_at(read_at_s, plate.force_n, recording.force_rate_hz) for plate in plates]) @ frame.T
    banded_n = np.array([low_pass(track, rate_hz, MOMENTUM_BAND_HZ) for track in force_n])
    gains: list[ChannelGain] = []
    n_free = 2.0 * MOMENTUM_BAND_HZ * (j - i - 2 * edge) / rate_hz
    inner = slice(edge, j - i - edge)
    for axis, together in ((_ALONG, False), (_ALONG, True), (_ACROSS, True), (_VERTICAL, False), (_VERTICAL, True)):
        # feet side by side push apart, so that across the walk only the sum of their forces moves the body
        tracks, banded, names = force_n[:, :, axis], banded_n[:, inner, axis], [plate.index for plate in plates]
        if together:
            tracks, banded, names = tracks.sum(axis=0)[None], banded.sum(axis=0)[None], [_ALL]
        judged = banded.std(axis=1) / weight_n > MIN_VARIATION[axis]
        if together and axis != _VERTICAL and is_walk:
            needs, measured = float(needed_n[inner, axis].std()) / weight_n, float(banded.std()) / weight_n
            if needs > _DEAD_NEEDS and measured < DEAD_SHARE * needs:
                gains.append(ChannelGain(_AXES[axis], _ALL, math.inf, 0.0))
        if not judged.any():
            continue
        b, sd = _slopes(needed_n[inner, axis], banded, judged, n_free)
        k = _position_gains(position_m[:, axis], tracks / mass_kg, judged, rate_hz)
        for n, here in enumerate(np.flatnonzero(judged)):
            candidates = (float(b[n]),) if axis == _VERTICAL else (float(b[n]), float(k[n]))
            nearer = min(candidates, key=_distance_from_one)
            if sd[n] <= MAX_SD * max(1.0, abs(nearer)):
                gains.append(ChannelGain(_AXES[axis], names[here], nearer, float(sd[n])))
    return tuple(gains)


def _at(time_s: Series, force_n: Float[np.ndarray, "samples 3"], rate_hz: float) -> Float[np.ndarray, "n 3"]:
    """Low-passed force at the instants ``time_s``."""
    smooth_n, force_time_s = low_pass_force(force_n, rate_hz), np.arange(len(force_n)) / rate_hz
    return np.column_stack([np.interp(time_s, force_time_s, smooth_n[:, j]) for j in range(3)])


def _slopes(
    needed_n: Float[np.ndarray, " frames"], tracks_n: Tracks, judged: Bool[np.ndarray, " plates"], n_free: float
) -> tuple[Gains, Gains]:
    """Slopes of the needed force on each judged track, and their standard errors for ``n_free`` independent samples.

    The tracks that vary too little are taken as they are.
    """
    A = np.column_stack([*tracks_n[judged], np.ones(tracks_n.shape[1])])
    y = needed_n - tracks_n[~judged].sum(axis=0)
    solution = np.linalg.lstsq(A, y, rcond=None)[0]
    variance = float(np.sum((y - A @ solution) ** 2)) / max(1.0, n_free - A.shape[1])
    sd = np.sqrt(np.diag(np.linalg.pinv(A.T @ A)) * variance)
    return solution[:-1], sd[:-1]


def _position_gains(
    position_m: Float[np.ndarray, " frames"],
    acceleration_m_s2: Tracks,
    judged: Bool[np.ndarray, " plates"],
    rate_hz: float,
) -> Gains:
    """Gains for which the twice integrated tracks explain the position; its drift (a parabola) is free."""
    double = acceleration_m_s2
    for _ in range(2):
        steps = 0.5 * (double[:, 1:] + double[:, :-1]) / rate_hz
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
