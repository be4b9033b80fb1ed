"""How late the force is against the markers, from the accelerations that both of them see.

Force and markers of real recordings run on clocks that differ by 8 to 20 ms. At 1.2 m/s that is 1 to 2.5 cm of apparent
error of the segment table, so it is estimated before anything is fused, and reported.

With ``F(t) = m (c'' - g)`` from the geometry and f the measured force, both in an 8 Hz band, rho(tau) is the
correlation of F(t - tau) with f(t) over the window, per axis. For an unknown gain, offset and noise level the profile
log-likelihood of a lag is ``-n/2 log(1 - rho(tau)^2)``; the axes "along the walk" and "vertical" add up. n is the
number of *independent* samples, about 12 per second in this band. F is cut to the window and filtered there exactly as
f is, so that the filter's edges are the same on both sides. The lateral axis is too quiet to tell (its lag scatters by
10 to 20 ms in real walks): it is reported, not used.

What the method reaches, and how other signs compare with it, is in ``docs/theory/synchronisation.md``.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from jaxtyping import Float
from scipy import interpolate

from stridelab.body.geometric_com import GeometricCom
from stridelab.conventions import GRAVITY_M_S2, Points, Rotation, Series
from stridelab.dynamics.newton_euler import contact_force
from stridelab.errors import NotEstimable
from stridelab.estimation.derivatives import BAND_HZ, derivatives, low_pass
from stridelab.estimation.span import Span, require_mass, window_span
from stridelab.recordings.recording import WrenchTrack

PerAxis = Float[np.ndarray, "3"]
PerLag = Float[np.ndarray, "lags 3"]
INDEPENDENT_PER_S: Final = 12.0
SIGNIFICANT_SD: Final = 1.0
"""A lag beyond this many standard deviations is taken out: from one on, that leaves a smaller error than leaving it."""
LEAST_S: Final = 0.003
"""A lag below this is left alone: 4 mm at walking speed, and as large as the method's own worst error."""
LARGEST_S: Final = 0.1
"""No clocks differ by more; what seems to is a resemblance by chance."""
LEAST_FORCE: Final = 0.01
"""Standard deviation of the force over the body's weight, along the walk and vertically, that is needed to tell a lag.

Persons who stand have 0.01 to 0.5 % along and 0.1 to 1.0 % vertically, walks 2 % and 3 % at least (shared recordings).
"""
_SEARCH_S = 0.05
_GRID_S = np.arange(-_SEARCH_S, _SEARCH_S + 1e-9, 0.001)
_ITERATIONS = 4
_WALKING_M_S = 0.3
_EDGE = 0.3
"""Part of a period of the band that is left out at either end of the window."""
_RESEMBLANCE = 0.5
_ALONG, _VERTICAL = 0, 2


@dataclass(frozen=True)
class AxisLag:
    """What one axis says by itself; ``correlation`` is the best it reaches over all lags."""

    lag_s: float
    sd_s: float
    correlation: float

    def later(self, shift_s: float) -> "AxisLag":
        """The same finding of a force that was read ``shift_s`` too late."""
        return replace(self, lag_s=self.lag_s + shift_s)


@dataclass(frozen=True)
class Latency:
    """``latency_s`` > 0 means the force is late. ``sd_s`` covers noise and the disagreement of the two axes.

    ``along``, ``lateral`` and ``vertical`` are the axes alone (along and across the walk); ``correlation`` is the
    smaller one of along and vertical at the common lag.
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
        return abs(self.latency_s) > max(SIGNIFICANT_SD * self.sd_s, LEAST_S)

    def later(self, shift_s: float) -> "Latency":
        """The same finding of a force that was read ``shift_s`` too late."""
        return replace(
            self,
            latency_s=self.latency_s + shift_s,
            along=self.along.later(shift_s),
            lateral=self.lateral.later(shift_s),
            vertical=self.vertical.later(shift_s),
        )


def estimate_latency(geometric: GeometricCom, wrench_at: Callable[[float], WrenchTrack], mass_kg: float) -> Latency:
    """Lag between force and markers over the longest window.

    ``wrench_at(latency_s)`` returns the force read that much later. Lags up to 50 ms are searched, again around what
    was found, until the rest is below half a millisecond. Raises as ``window_span`` does, and ``NotEstimable`` with
    ``latency-unclear`` when the force hardly varies (standing still), when the accelerations do not resemble each other
    (wrong plates), when the likeliest lag lies at the edge of the search, and when it adds up to more than
    ``LARGEST_S``.
    """
    require_mass(mass_kg)
    read_later_s = 0.0
    for _ in range(_ITERATIONS):
        wrench = wrench_at(read_later_s)
        rest = _lag(geometric, wrench, window_span(geometric, wrench), mass_kg)
        found = rest.later(read_later_s)
        if abs(found.latency_s) > LARGEST_S:
            raise _beyond(LARGEST_S)
        read_later_s = found.latency_s
        if abs(rest.latency_s) < 0.0005:
            break
    return found


def _beyond(searched_s: float) -> NotEstimable:
    return NotEstimable(
        "latency-unclear",
        "The accelerations seen by the markers and by the plates agree best when one is moved by "
        f"{1e3 * searched_s:.0f} ms or more: no clocks differ by that much, so their delay cannot be told.",
    )


def _lag(geometric: GeometricCom, wrench: WrenchTrack, span: Span, mass_kg: float) -> Latency:
    """Remaining lag of an already shifted force."""
    rate_hz = span.rate_hz
    velocity, acceleration = derivatives(geometric.com_m[span.around], rate_hz)
    R = _walking_axes(velocity[span.within], acceleration[span.within])
    F = interpolate.CubicSpline(np.arange(len(acceleration)) / rate_hz, contact_force(acceleration, mass_kg) @ R.T)
    # The geometry's own ends have no good acceleration, and no lag may read beyond them.
    spare = int(np.ceil((_SEARCH_S + 2 * _EDGE / BAND_HZ) * rate_hz))
    first = max(span.within.start, spare)
    last = max(first + 1, min(span.within.stop, len(acceleration) - spare))
    t = np.arange(first, last) / rate_hz
    edge = int(np.ceil(_EDGE * rate_hz / BAND_HZ))
    f_window = wrench.force_n[span.around][first:last] @ R.T
    if len(t) <= 3 * edge:
        raise NotEstimable(
            "latency-unclear",
            "The markers end together with the measured force: too little is left to compare their clocks.",
        )
    f = low_pass(f_window, rate_hz)[edge:-edge]
    varies = float(f.std(axis=0)[[_ALONG, _VERTICAL]].min() / (mass_kg * GRAVITY_M_S2))
    if varies < LEAST_FORCE:
        raise NotEstimable(
            "latency-unclear",
            f"The force varies by {varies:.1%} of the body's weight only, as of a person who stands: the delay between "
            "the clocks of force and markers cannot be told.",
        )
    rho: PerLag = np.array([_correlation(low_pass(np.asarray(F(t - tau)), rate_hz)[edge:-edge], f) for tau in _GRID_S])
    best = rho.max(axis=0)
    if not min(best[_ALONG], best[_VERTICAL]) > _RESEMBLANCE:
        raise NotEstimable(
            "latency-unclear",
            "The accelerations seen by the markers and by the plates do not resemble each other "
            f"(correlation {min(best[_ALONG], best[_VERTICAL]):.2f}), so their delay cannot be told.",
        )
    n = INDEPENDENT_PER_S * len(f) / rate_hz
    likelihood = -n / 2 * np.log(1 - np.minimum(np.maximum(rho, 0.0), 1 - 1e-9) ** 2)
    both = likelihood[:, _ALONG] + likelihood[:, _VERTICAL]
    if np.argmax(both) in (0, len(both) - 1):
        raise _beyond(_SEARCH_S)
    total, sd_s = _peak(both)
    along, lateral, vertical = (AxisLag(*_peak(likelihood[:, j]), float(best[j])) for j in range(3))
    at_total = rho[np.argmin(np.abs(_GRID_S - total))]
    return Latency(
        latency_s=total,
        sd_s=float(np.hypot(sd_s, (along.lag_s - vertical.lag_s) / 2)),
        along=along,
        lateral=lateral,
        vertical=vertical,
        correlation=float(min(at_total[_ALONG], at_total[_VERTICAL])),
    )


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


def _peak(likelihood: Series) -> tuple[float, float]:
    """Position of the maximum and its standard deviation, from the parabola through the three best lags."""
    i = int(np.clip(np.argmax(likelihood), 1, len(likelihood) - 2))
    below, at, above = likelihood[i - 1 : i + 2]
    curvature = below - 2 * at + above
    step = _GRID_S[1] - _GRID_S[0]
    if curvature >= 0:
        return float(_GRID_S[np.argmax(likelihood)]), _SEARCH_S
    return float(_GRID_S[i] + step * (below - above) / (2 * curvature)), float(step / np.sqrt(-curvature))
