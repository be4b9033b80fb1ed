"""How late the force is against the markers, from the two accelerations that both of them see.

Force and markers of real recordings run on clocks that differ by 8 to 20 ms. At 1.2 m/s that is 1 to 2.5 cm of apparent
error of the segment table, so it is estimated before anything is fused, and reported.

With ``F(t) = m (c'' - g)`` from the geometry and f the measured force, both in an 8 Hz band, rho(tau) is the
correlation of F(t) with f(t + tau) over the window, per axis. For an unknown gain, offset and noise level the profile
log-likelihood of a lag is ``-n/2 log(1 - rho(tau)^2)``; the axes "along the walk" and "vertical" add up. n is the
number of *independent* samples, about 12 per second in this band.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy import interpolate

from stridelab.body.geometric_com import GeometricCom
from stridelab.conventions import Points, Series, Vector3
from stridelab.dynamics.newton_euler import contact_force
from stridelab.errors import NotEstimable
from stridelab.estimation.derivatives import BAND_HZ, derivatives, low_pass
from stridelab.estimation.span import Span, require_mass, window_span
from stridelab.recordings.recording import WrenchTrack

PerAxis = Float[np.ndarray, "n 2"]
INDEPENDENT_PER_S = 12.0
_SEARCH_S = 0.05
_GRID_S = np.arange(-_SEARCH_S, _SEARCH_S + 1e-9, 0.001)
_ITERATIONS = 4
_WALKING_M_S = 0.3


@dataclass(frozen=True)
class Latency:
    """``latency_s`` > 0 means the force is late. ``sd_s`` covers noise and the disagreement of the two axes.

    ``along_s`` and ``vertical_s`` are the lags of each axis alone; ``correlation`` is the smaller of the two at the
    common lag.
    """

    latency_s: float
    sd_s: float
    along_s: float
    vertical_s: float
    correlation: float


def estimate_latency(geometric: GeometricCom, wrench_at: Callable[[float], WrenchTrack], mass_kg: float) -> Latency:
    """Lag between force and markers over the longest window.

    ``wrench_at(latency_s)`` returns the force read that much later. Lags up to 50 ms are searched, again around what
    was found, until the rest is below half a millisecond. Raises as ``window_span`` does, and ``NotEstimable`` with
    ``latency-unclear`` when the accelerations do not resemble each other (standing still, wrong mass sign, wrong
    plates).
    """
    require_mass(mass_kg)
    found = 0.0
    for _ in range(_ITERATIONS):
        wrench = wrench_at(found)
        fit = _lag(geometric, wrench, window_span(geometric, wrench), mass_kg)
        found += fit.latency_s
        if abs(fit.latency_s) < 0.0005:
            break
    shift = found - fit.latency_s
    return Latency(found, fit.sd_s, fit.along_s + shift, fit.vertical_s + shift, fit.correlation)


def _lag(geometric: GeometricCom, wrench: WrenchTrack, span: Span, mass_kg: float) -> Latency:
    """Remaining lag of an already shifted force."""
    rate_hz = span.rate_hz
    edge = int(np.ceil(0.6 * rate_hz / BAND_HZ))
    trimmed = slice(span.within.start + edge, span.within.stop - edge)
    velocity, acceleration = derivatives(geometric.com_m[span.around], rate_hz)
    axes = np.array([_along(velocity[trimmed], acceleration[trimmed]), [0.0, 0.0, 1.0]])
    F = contact_force(acceleration, mass_kg) @ axes.T
    f = (low_pass(wrench.force_n[span.inside], rate_hz)[edge:-edge]) @ axes.T
    t = np.arange(len(F)) / rate_hz
    shifted = interpolate.CubicSpline(t, F)
    rho = np.array([_correlation(shifted(t[trimmed] - tau), f) for tau in _GRID_S])
    if not (rho.max(axis=0) > 0.5).all():
        raise NotEstimable(
            "latency-unclear",
            "The accelerations seen by the markers and by the plates do not resemble each other "
            f"(correlation {rho.max(axis=0).min():.2f}), so their delay cannot be told.",
        )
    n = INDEPENDENT_PER_S * len(f) / rate_hz
    likelihood = -n / 2 * np.log(1 - np.minimum(np.maximum(rho, 0.0), 1 - 1e-9) ** 2)
    total, sd_s = _peak(likelihood.sum(axis=1))
    (along, _), (vertical, _) = (_peak(likelihood[:, j]) for j in (0, 1))
    return Latency(
        latency_s=total,
        sd_s=float(np.hypot(sd_s, (along - vertical) / 2)),
        along_s=along,
        vertical_s=vertical,
        correlation=float(rho[np.argmin(np.abs(_GRID_S - total))].min()),
    )


def _along(velocity: Points, acceleration: Points) -> Vector3:
    """Horizontal unit vector of the walk; of a body that stays, the direction in which it accelerates most."""
    mean = velocity.mean(axis=0) * [1.0, 1.0, 0.0]
    if np.linalg.norm(mean) < _WALKING_M_S:
        mean = np.append(np.linalg.svd(acceleration[:, :2] - acceleration[:, :2].mean(axis=0))[2][0], 0.0)
    return np.asarray(mean / np.linalg.norm(mean))


def _correlation(x: PerAxis, y: PerAxis) -> Float[np.ndarray, "2"]:
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
