"""Estimates the delay of the force relative to the markers from the motion that both measure.

The clocks of force and markers in real recordings differ by 8 to 20 ms. At 1.2 m/s that is 1 to 2.5 cm of apparent
error of the segment table, so the delay is estimated before the fusion, and reported: the maximum-likelihood delay
between the path integrated from the force and the geometric path (``clock_likelihood``), searched within 50 ms and then
refined.

The lags of the single axes are computed independently of the table's errors. With ``F(t) = m (c'' - g)`` from the
geometry and f the measured force, both in an 8 Hz band, rho(tau) is the correlation of F(t - tau) with f(t), and
``-n/2 log(1 - rho(tau)^2)`` the profile log-likelihood of a lag for an unknown gain, offset and noise; n counts about
12 independent samples per second. F is cut to the window and filtered exactly as f, so that edge effects are the same
on both sides.

The accuracy and a comparison with other methods are in ``docs/theory/synchronisation.md``.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from jaxtyping import Float
from scipy import interpolate

from stridelab.body.geometric_com import GeometricCom
from stridelab.conventions import GRAVITY_M_S2, PerAxis, Points, Rotation, Series
from stridelab.dynamics.wrench import contact_force
from stridelab.errors import NotEstimable
from stridelab.estimation.differentiation import (
    BAND_HZ,
    Span,
    low_pass,
    require_mass,
    smoothed_derivatives,
    window_span,
)
from stridelab.estimation.latency_likelihood import clock_likelihood
from stridelab.recordings.recording import WrenchTrack

PerLag = Float[np.ndarray, "lags 3"]
Lags = Float[np.ndarray, "lags"]
INDEPENDENT_PER_S: Final = 12.0
SIGNIFICANT_SD: Final = 1.0
"""Lags beyond this many standard deviations are corrected: from one on, correction leaves the smaller error."""
REPEATABILITY_SD_S: Final = 0.0012
"""Standard deviation between repeated trials of one session beyond the width of the likelihood.

From 94 trials of 33 people on one clock each; fitted to either half of them, it holds on the other half:
``docs/theory/sessions.md``.
"""
WIDE_S: Final = 0.0025
"""Width of the likelihood at which its own error is as large as the width; fitted with the above: sessions.md."""
MIN_LAG_S: Final = 0.002
"""Smaller lags are not corrected: 2.4 mm at walking speed, as large as the method's largest error."""
MAX_LAG_S: Final = 0.1
"""Largest plausible lag; larger ones are chance correlations."""
MIN_FORCE_VARIATION: Final = 0.01
"""Minimum standard deviation of the force over body weight, ahead and vertically, for estimating a lag.

In real recordings quiet stance has 0.05 to 0.5 %, walks have at least 3 %.
"""
MIN_VERTICAL_VARIATION: Final = 0.1
"""Vertical variation that suffices alone, for jumps on the spot: walks have 10 to 20 %, jumps 50 to 150 %."""
MIN_CORRELATION: Final = 0.8
"""Minimum correlation of the two paths, without what errors of the table and of the gain explain.

Walks have at least 0.99, with 15 mm of noise 0.9; most forces of another walk have less, or a lag at the edge of the
search range."""
MAX_SD_S: Final = 0.01
"""Largest standard deviation of a useful estimate: lags lie within 25 ms anyway."""
LONGEST_S: Final = 6.0
"""Part of a window from which the remaining error of a corrected latency is estimated."""
PRIOR_WIDTHS: Final = 3.0
_SEARCH_S, _REFINED_SEARCH_S, _STEP_S = 0.05, 0.006, 0.001
_NEAR_S, _FEWEST_LAGS = 0.015, 5
_ITERATIONS = 8
_WALKING_M_S = 0.3
_EDGE = 0.3
"""Part of a period of the band that is excluded at either end of the window."""
_VERTICAL = 2


@dataclass(frozen=True)
class AxisLag:
    """Lag estimated from one axis alone; ``correlation`` is the largest of its accelerations over all lags."""

    lag_s: float
    sd_s: float
    correlation: float


@dataclass(frozen=True)
class Latency:
    """Latency of the force; ``latency_s`` > 0 means the force is late.

    ``sd_s`` follows from the width of its likelihood (``repeated_sd_s``).

    ``along``, ``lateral`` and ``vertical`` are estimated from the accelerations of one axis each (along and across the
    walk) and are biased by table errors; ``correlation`` is that of the two paths at the latency, without table errors.
    """

    latency_s: float
    sd_s: float
    along: AxisLag
    lateral: AxisLag
    vertical: AxisLag
    correlation: float

    @property
    def significant(self) -> bool:
        """Whether correcting this lag reduces the error."""
        return is_significant(self.latency_s, self.sd_s)


def is_significant(latency_s: float, sd_s: float) -> bool:
    """Whether correcting a lag with this standard deviation reduces the error."""
    return abs(latency_s) > max(SIGNIFICANT_SD * sd_s, MIN_LAG_S)


def repeated_sd_s(width_s: float) -> float:
    """Standard deviation between repeated trials of a person whose likelihood has this width.

    ``REPEATABILITY_SD_S`` is the least. Where the motion says little, as in a slow walk, errors of the markers that
    repeat with every step pass for a delay, and the likelihood takes them for signal: the excess grows as width^2.
    """
    return float(np.sqrt(width_s**2 + REPEATABILITY_SD_S**2 + (width_s**2 / WIDE_S) ** 2))


def estimate_latency(geometric: GeometricCom, wrench_at: Callable[[float], WrenchTrack], mass_kg: float) -> Latency:
    """Lag between force and markers over the longest window.

    ``wrench_at(latency_s)`` returns the force read that much later. Raises as ``window_span`` does, and
    ``NotEstimable`` with ``latency-unclear`` if the force hardly varies (standing still), the two motions are not
    correlated (wrong plates), the likeliest lag lies at the edge of the search range or adds up to more than
    ``MAX_LAG_S``, or its standard deviation exceeds ``MAX_SD_S``.
    """
    require_mass(mass_kg)
    latency_s, everywhere = 0.0, True
    for _ in range(_ITERATIONS):
        lags = _lag_grid(_SEARCH_S if everywhere else _REFINED_SEARCH_S)
        wrench = wrench_at(latency_s)
        span = window_span(geometric, wrench)
        _require_motion(wrench, span, mass_kg)
        velocity, acceleration = smoothed_derivatives(geometric.com_m[span.around], span.rate_hz)
        R = _walking_axes(velocity[span.within] - geometric.ground_m_s, acceleration[span.within])
        likelihood = clock_likelihood(geometric, wrench, span, mass_kg, R, lags)
        if everywhere and np.argmax(likelihood.log_likelihood) in (0, len(lags) - 1):
            raise _lag_too_large_error(_SEARCH_S)
        rest_s, sd_s = _parabola_peak(lags, likelihood.log_likelihood)
        latency_s += rest_s
        if abs(latency_s) > MAX_LAG_S:
            raise _lag_too_large_error(MAX_LAG_S)
        if not everywhere and abs(rest_s) < _STEP_S / 2:
            break
        everywhere = False
    if abs(rest_s) > _REFINED_SEARCH_S / 2:
        raise _lag_too_large_error(abs(latency_s))
    if likelihood.correlation < MIN_CORRELATION:
        raise NotEstimable(
            "latency-unclear",
            "The motions measured by the markers and by the plates do not resemble each other "
            f"(correlation {likelihood.correlation:.2f}), so their delay cannot be determined.",
        )
    if sd_s > MAX_SD_S:
        raise NotEstimable(
            "latency-unclear",
            f"The delay between force and markers is uncertain by {1e3 * sd_s:.0f} ms: there is too little motion.",
        )
    wrench = wrench_at(0.0)
    along, lateral, vertical = _axis_lags(geometric, wrench, window_span(geometric, wrench), mass_kg, R)
    return Latency(latency_s, repeated_sd_s(sd_s), along, lateral, vertical, likelihood.correlation)


@dataclass(frozen=True)
class ClockError:
    """Remaining latency of the force, posterior mean and standard deviation."""

    mean_s: float
    sd_s: float


def remaining_clock_error(
    geometric: GeometricCom, wrench: WrenchTrack, span: Span, mass_kg: float, prior_s: float
) -> ClockError:
    """Latency of the force within a normal prior of zero mean, from at most ``LONGEST_S`` of the window.

    The prior remains where the recording cannot say more: its clocks have been compared before (what remains is the
    error of that estimate), the likelihood is broad or largest at the edge of the search range, the two paths do not
    resemble each other, or force is withheld.
    """
    prior = ClockError(0.0, prior_s)
    if wrench.clocks_compared or wrench.withheld is not None:
        return prior
    spare = max(0, (span.inside.stop - span.inside.start - round(LONGEST_S * span.rate_hz)) // 2)
    middle = replace(span, inside=slice(span.inside.start + spare, span.inside.stop - spare))
    lags = _lag_grid(min(PRIOR_WIDTHS * prior_s, _NEAR_S))
    if len(lags) < _FEWEST_LAGS:
        return prior
    velocity, acceleration = smoothed_derivatives(geometric.com_m[span.around], span.rate_hz)
    R = _walking_axes(velocity[span.within] - geometric.ground_m_s, acceleration[span.within])
    likelihood = clock_likelihood(geometric, wrench, middle, mass_kg, R, lags)
    log_likelihood = likelihood.log_likelihood
    if np.argmax(log_likelihood) in (0, len(lags) - 1) or likelihood.correlation < MIN_CORRELATION:
        return prior
    weights = np.exp(log_likelihood - log_likelihood.max())
    weights /= weights.sum()
    mean_s = float(weights @ lags)
    variance_s2 = repeated_sd_s(float(np.sqrt(weights @ (lags - mean_s) ** 2))) ** 2
    kept = prior_s**2 / (prior_s**2 + variance_s2)
    return ClockError(kept * mean_s, float(np.sqrt(kept * variance_s2)))


def _lag_too_large_error(searched_s: float) -> NotEstimable:
    return NotEstimable(
        "latency-unclear",
        "The motions measured by the markers and by the plates agree best when one is shifted by "
        f"{1e3 * searched_s:.0f} ms or more: clocks do not differ by that much, so their delay cannot be determined.",
    )


def _lag_grid(reach_s: float) -> Lags:
    return np.arange(-reach_s, reach_s + 1e-9, _STEP_S)


def _require_motion(wrench: WrenchTrack, span: Span, mass_kg: float) -> None:
    """Raise unless the force varies enough, vertically and in its main horizontal direction, or much vertically."""
    f = low_pass(wrench.force_n[span.inside], span.rate_hz) / (mass_kg * GRAVITY_M_S2)
    ahead = np.linalg.norm(f[:, :2] - f[:, :2].mean(axis=0), 2) / np.sqrt(len(f))
    vertical = float(f[:, _VERTICAL].std())
    varies = float(min(ahead, vertical))
    if varies < MIN_FORCE_VARIATION and vertical < MIN_VERTICAL_VARIATION:
        raise NotEstimable(
            "latency-unclear",
            f"The force varies by only {varies:.1%} of the body weight, as in quiet stance: the delay between the "
            "clocks of force and markers cannot be determined.",
        )


def _axis_lags(
    geometric: GeometricCom, wrench: WrenchTrack, span: Span, mass_kg: float, R: Rotation
) -> tuple[AxisLag, AxisLag, AxisLag]:
    """Lags estimated from the accelerations along, across and upwards, each alone."""
    rate_hz, lags = span.rate_hz, _lag_grid(_SEARCH_S)
    acceleration = smoothed_derivatives(geometric.com_m[span.around], rate_hz)[1]
    F = interpolate.CubicSpline(np.arange(len(acceleration)) / rate_hz, contact_force(acceleration, mass_kg) @ R.T)
    # The acceleration is inaccurate at the ends of the geometry, and no lag may read beyond them.
    spare = int(np.ceil((_SEARCH_S + 2 * _EDGE / BAND_HZ) * rate_hz))
    first = max(span.within.start, spare)
    last = max(first + 1, min(span.within.stop, len(acceleration) - spare))
    t = np.arange(first, last) / rate_hz
    edge = int(np.ceil(_EDGE * rate_hz / BAND_HZ))
    if len(t) <= 3 * edge:
        raise NotEstimable(
            "latency-unclear",
            "The markers end together with the measured force: too few samples are left to compare their clocks.",
        )
    f = low_pass(wrench.force_n[span.around][first:last] @ R.T, rate_hz)[edge:-edge]
    rho: PerLag = np.array(
        [_axis_correlation(low_pass(np.asarray(F(t - tau)), rate_hz)[edge:-edge], f) for tau in lags]
    )
    n = INDEPENDENT_PER_S * len(f) / rate_hz
    likelihood = -n / 2 * np.log(1 - np.minimum(np.maximum(rho, 0.0), 1 - 1e-9) ** 2)
    along, lateral, vertical = (
        AxisLag(*_parabola_peak(lags, likelihood[:, j]), float(rho[:, j].max())) for j in range(3)
    )
    return along, lateral, vertical


def _walking_axes(velocity: Points, acceleration: Points) -> Rotation:
    """Rows: along the walk, across it, up. For a body that stays in place, "along" is its main acceleration."""
    mean = velocity.mean(axis=0) * [1.0, 1.0, 0.0]
    if np.linalg.norm(mean) < _WALKING_M_S:
        mean = np.append(np.linalg.svd(acceleration[:, :2] - acceleration[:, :2].mean(axis=0))[2][0], 0.0)
    along, up = mean / np.linalg.norm(mean), np.array([0.0, 0.0, 1.0])
    return np.array([along, np.cross(up, along), up])


def _axis_correlation(x: Points, y: Points) -> PerAxis:
    x, y = x - x.mean(axis=0), y - y.mean(axis=0)
    norm = np.sqrt((x**2).sum(axis=0) * (y**2).sum(axis=0))
    return np.asarray((x * y).sum(axis=0) / np.maximum(norm, 1e-12))


def _parabola_peak(lags: Lags, likelihood: Series) -> tuple[float, float]:
    """Position of the maximum and its standard deviation, from the parabola through the three best lags."""
    i = int(np.clip(np.argmax(likelihood), 1, len(likelihood) - 2))
    below, at, above = likelihood[i - 1 : i + 2]
    curvature = below - 2 * at + above
    if curvature >= 0:
        return float(lags[np.argmax(likelihood)]), _SEARCH_S
    shift_s = np.clip(_STEP_S * (below - above) / (2 * curvature), -_STEP_S, _STEP_S)
    return float(lags[i] + shift_s), float(_STEP_S / np.sqrt(-curvature))
