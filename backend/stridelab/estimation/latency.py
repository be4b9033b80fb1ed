"""How late the force is against the markers, from the motion that both of them see.

Force and markers of real recordings run on clocks that differ by 8 to 20 ms. At 1.2 m/s that is 1 to 2.5 cm of apparent
error of the segment table, so it is estimated before anything is fused, and reported: the likeliest delay of the path
that the force makes of the body (``clock_likelihood``), searched within 50 ms and again, finer, around what was found.

Beside it stand the signs of the axes alone, which know nothing of the table. With ``F(t) = m (c'' - g)`` from the
geometry and f the measured force, both in an 8 Hz band, rho(tau) is the correlation of F(t - tau) with f(t), and
``-n/2 log(1 - rho(tau)^2)`` the profile log-likelihood of a lag for an unknown gain, offset and noise; n counts about
12 independent samples per second. F is cut to the window and filtered there exactly as f is, so that the filter's edges
are the same on both sides.

What the method reaches, and how other signs compare with it, is in ``docs/theory/synchronisation.md``.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float
from scipy import interpolate

from stridelab.body.geometric_com import GeometricCom
from stridelab.conventions import GRAVITY_M_S2, PerAxis, Points, Rotation, Series
from stridelab.dynamics.newton_euler import contact_force
from stridelab.errors import NotEstimable
from stridelab.estimation.differentiation import BAND_HZ, derivatives, low_pass
from stridelab.estimation.latency_likelihood import clock_likelihood
from stridelab.estimation.time_span import Span, require_mass, window_span
from stridelab.recordings.recording import WrenchTrack

PerLag = Float[np.ndarray, "lags 3"]
Lags = Float[np.ndarray, "lags"]
INDEPENDENT_PER_S: Final = 12.0
SIGNIFICANT_SD: Final = 1.0
"""A lag beyond this many standard deviations is taken out: from one on, that leaves a smaller error than leaving it."""
REPEATS: Final = 1.4
"""Repeated trials of one session scatter by this many times the width of the likelihood: its noise is no white one.

Calibrated on 6 adults (18 trials) and tested on 12 others: ``docs/theory/sessions.md``.
"""
LEAST_S: Final = 0.002
"""A lag below this is left alone: 2.4 mm at walking speed, and as large as the method's own worst error."""
LARGEST_S: Final = 0.1
"""No clocks differ by more; what seems to is a resemblance by chance."""
LEAST_FORCE: Final = 0.01
"""Standard deviation of the force over the body's weight that is needed to tell a lag, ahead and vertically.

In the real recordings persons who stand have 0.05 to 0.5 %, walks 3 % at least.
"""
LEAST_CORRELATION: Final = 0.8
"""Of the two paths. Walks have 0.93 and more; the force of another walk has less, or a lag at the search's edge."""
WORST_SD_S: Final = 0.01
"""Less certain than this is nothing found: a lag lies within 25 ms anyway."""
_SEARCH_S, _NEAR_S, _STEP_S = 0.05, 0.006, 0.001
_ITERATIONS = 8
_WALKING_M_S = 0.3
_EDGE = 0.3
"""Part of a period of the band that is left out at either end of the window."""
_VERTICAL = 2


@dataclass(frozen=True)
class AxisLag:
    """What one axis says by itself; ``correlation`` is the best that its accelerations reach over all lags."""

    lag_s: float
    sd_s: float
    correlation: float


@dataclass(frozen=True)
class Latency:
    """``latency_s`` > 0 means the force is late; ``sd_s`` is ``REPEATS`` times the width of its likelihood.

    ``along``, ``lateral`` and ``vertical`` are the accelerations of each axis alone (along and across the walk), for
    which a wrong table is a lag; ``correlation`` is that of the two paths at the latency.
    """

    latency_s: float
    sd_s: float
    along: AxisLag
    lateral: AxisLag
    vertical: AxisLag
    correlation: float

    @property
    def significant(self) -> bool:
        """Whether taking this lag out is better than leaving it in."""
        return is_significant(self.latency_s, self.sd_s)


def is_significant(latency_s: float, sd_s: float) -> bool:
    """Whether taking a lag with this standard deviation out is better than leaving it in."""
    return abs(latency_s) > max(SIGNIFICANT_SD * sd_s, LEAST_S)


def estimate_latency(geometric: GeometricCom, wrench_at: Callable[[float], WrenchTrack], mass_kg: float) -> Latency:
    """Lag between force and markers over the longest window.

    ``wrench_at(latency_s)`` returns the force read that much later. Raises as ``window_span`` does, and
    ``NotEstimable`` with ``latency-unclear`` when the force hardly varies (standing still), when the two motions do not
    resemble each other (wrong plates), when the likeliest lag lies at the edge of the search or adds up to more than
    ``LARGEST_S``, and when its likelihood is wider than ``WORST_SD_S``.
    """
    require_mass(mass_kg)
    latency_s, everywhere = 0.0, True
    for _ in range(_ITERATIONS):
        lags = _grid(_SEARCH_S if everywhere else _NEAR_S)
        wrench = wrench_at(latency_s)
        span = window_span(geometric, wrench)
        _require_motion(wrench, span, mass_kg)
        R = _walking_axes(*(x[span.within] for x in derivatives(geometric.com_m[span.around], span.rate_hz)))
        found = clock_likelihood(geometric, wrench, span, mass_kg, R, lags)
        if everywhere and np.argmax(found.log_likelihood) in (0, len(lags) - 1):
            raise _beyond(_SEARCH_S)
        rest_s, sd_s = _peak(lags, found.log_likelihood)
        latency_s += rest_s
        if abs(latency_s) > LARGEST_S:
            raise _beyond(LARGEST_S)
        if not everywhere and abs(rest_s) < _STEP_S / 2:
            break
        everywhere = False
    if abs(rest_s) > _NEAR_S / 2:
        raise _beyond(abs(latency_s))
    if found.correlation < LEAST_CORRELATION:
        raise NotEstimable(
            "latency-unclear",
            "The motions seen by the markers and by the plates do not resemble each other "
            f"(correlation {found.correlation:.2f}), so their delay cannot be told.",
        )
    if sd_s > WORST_SD_S:
        raise NotEstimable(
            "latency-unclear",
            f"The delay between force and markers is uncertain by {1e3 * sd_s:.0f} ms: too little motion is seen.",
        )
    wrench = wrench_at(0.0)
    along, lateral, vertical = _axis_lags(geometric, wrench, window_span(geometric, wrench), mass_kg, R)
    return Latency(latency_s, REPEATS * sd_s, along, lateral, vertical, found.correlation)


def _beyond(searched_s: float) -> NotEstimable:
    return NotEstimable(
        "latency-unclear",
        "The motions seen by the markers and by the plates agree best when one is moved by "
        f"{1e3 * searched_s:.0f} ms or more: no clocks differ by that much, so their delay cannot be told.",
    )


def _grid(reach_s: float) -> Lags:
    return np.arange(-reach_s, reach_s + 1e-9, _STEP_S)


def _require_motion(wrench: WrenchTrack, span: Span, mass_kg: float) -> None:
    """Raise unless the force, along where it is largest and upwards, varies as that of somebody who moves."""
    f = low_pass(wrench.force_n[span.inside], span.rate_hz) / (mass_kg * GRAVITY_M_S2)
    ahead = np.linalg.norm(f[:, :2] - f[:, :2].mean(axis=0), 2) / np.sqrt(len(f))
    varies = float(min(ahead, f[:, _VERTICAL].std()))
    if varies < LEAST_FORCE:
        raise NotEstimable(
            "latency-unclear",
            f"The force varies by {varies:.1%} of the body's weight only, as of a person who stands: the delay between "
            "the clocks of force and markers cannot be told.",
        )


def _axis_lags(
    geometric: GeometricCom, wrench: WrenchTrack, span: Span, mass_kg: float, R: Rotation
) -> tuple[AxisLag, AxisLag, AxisLag]:
    """The lag as the accelerations along, across and upwards see it, each alone."""
    rate_hz, lags = span.rate_hz, _grid(_SEARCH_S)
    acceleration = derivatives(geometric.com_m[span.around], rate_hz)[1]
    F = interpolate.CubicSpline(np.arange(len(acceleration)) / rate_hz, contact_force(acceleration, mass_kg) @ R.T)
    # The geometry's own ends have no good acceleration, and no lag may read beyond them.
    spare = int(np.ceil((_SEARCH_S + 2 * _EDGE / BAND_HZ) * rate_hz))
    first = max(span.within.start, spare)
    last = max(first + 1, min(span.within.stop, len(acceleration) - spare))
    t = np.arange(first, last) / rate_hz
    edge = int(np.ceil(_EDGE * rate_hz / BAND_HZ))
    if len(t) <= 3 * edge:
        raise NotEstimable(
            "latency-unclear",
            "The markers end together with the measured force: too little is left to compare their clocks.",
        )
    f = low_pass(wrench.force_n[span.around][first:last] @ R.T, rate_hz)[edge:-edge]
    rho: PerLag = np.array([_correlation(low_pass(np.asarray(F(t - tau)), rate_hz)[edge:-edge], f) for tau in lags])
    n = INDEPENDENT_PER_S * len(f) / rate_hz
    likelihood = -n / 2 * np.log(1 - np.minimum(np.maximum(rho, 0.0), 1 - 1e-9) ** 2)
    along, lateral, vertical = (AxisLag(*_peak(lags, likelihood[:, j]), float(rho[:, j].max())) for j in range(3))
    return along, lateral, vertical


def _walking_axes(velocity: Points, acceleration: Points) -> Rotation:
    """Rows: along the walk, across it, up. Of a body that stays, "along" is where it accelerates most."""
    mean = velocity.mean(axis=0) * [1.0, 1.0, 0.0]
    if np.linalg.norm(mean) < _WALKING_M_S:
        mean = np.append(np.linalg.svd(acceleration[:, :2] - acceleration[:, :2].mean(axis=0))[2][0], 0.0)
    along, up = mean / np.linalg.norm(mean), np.array([0.0, 0.0, 1.0])
    return np.array([along, np.cross(up, along), up])


def _correlation(x: Points, y: Points) -> PerAxis:
    x, y = x - x.mean(axis=0), y - y.mean(axis=0)
    norm = np.sqrt((x**2).sum(axis=0) * (y**2).sum(axis=0))
    return np.asarray((x * y).sum(axis=0) / np.maximum(norm, 1e-12))


def _peak(lags: Lags, likelihood: Series) -> tuple[float, float]:
    """Position of the maximum and its standard deviation, from the parabola through the three best lags."""
    i = int(np.clip(np.argmax(likelihood), 1, len(likelihood) - 2))
    below, at, above = likelihood[i - 1 : i + 2]
    curvature = below - 2 * at + above
    if curvature >= 0:
        return float(lags[np.argmax(likelihood)]), _SEARCH_S
    shift_s = np.clip(_STEP_S * (below - above) / (2 * curvature), -_STEP_S, _STEP_S)
    return float(lags[i] + shift_s), float(_STEP_S / np.sqrt(-curvature))
