"""Robust random-effects mean of repeated measurements whose stated errors may be too small, with outliers.

Random-effects model: x_i = mu + b_i + e_i with stated e_i ~ N(0, v_i) and b_i ~ N(0, tau^2) with unknown tau. With
w_i = 1 / (v_i + tau^2) and z_i = sqrt(w_i) (x_i - mu), the mean is Huber's
M-estimate (`huber1964`),

    sum_i sqrt(w_i) psi(z_i) = 0,    psi(z) = max(-C, min(C, z)),

and the excess variance tau^2 >= 0 is the one at which the residuals have their expected size (`paule1982` with Huber's
Proposal 2),

    sum_i psi(z_i)^2 = (n - 1) E[psi(Z)^2],    Z ~ N(0, 1),

or 0 if they are smaller already. An outlier counts as one of C standard deviations, regardless of its size. The
variance of mu is 1 / sum_i h_i w_i with h_i = min(1, C / |z_i|). Sums are exact (``math.fsum``), so that the result
does not depend on the order of the measurements.

With ``scaled`` errors the variances are (1 + tau^2) v_i in place of v_i + tau^2 (the square of the Birge ratio): where
the stated errors differ by a factor of ten and a few measurements have failed, the accurate ones keep their weight.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from stridelab.errors import InvalidInput

C: Final = 1.345
"""Residuals are clipped to this many standard deviations: 95 % efficiency for normal errors."""
_EXPECTED: Final = (
    math.erf(C / math.sqrt(2.0)) * (1.0 - C**2)
    - C * math.sqrt(2.0 / math.pi) * math.exp(-(C**2) / 2.0)
    + C**2
)  # fmt: skip
"""E[psi(Z)^2] of a standard normal Z."""
_STEPS: Final = 60
"""Maximum number of iterations; a bisection then reaches double precision."""


@dataclass(frozen=True)
class Pooled:
    """Mean of ``n`` measurements with its standard deviation.

    ``excess_sd`` is tau, the scatter beyond the stated errors (without unit if they are scaled); ``chi_squared`` is
    sum (x_i - mu)^2 / v_i with the stated errors, to be compared with n - 1; ``weights`` add up to 1.
    """

    mean: float
    sd: float
    excess_sd: float
    chi_squared: float
    weights: tuple[float, ...]

    @property
    def n(self) -> int:
        """Number of measurements."""
        return len(self.weights)


def pool_measurements(values: Sequence[float], sds: Sequence[float], *, scaled: bool = False) -> Pooled:
    """Random-effects mean of ``values`` with standard deviations ``sds``, in the unit of both.

    ``scaled`` multiplies the stated variances where the scatter exceeds them, instead of adding to them.

    Raises ``InvalidInput`` (``nothing-to-pool``) without values, for different lengths, or if a standard deviation is
    not positive.
    """
    if not values or len(values) != len(sds) or not all(sd > 0.0 for sd in sds):
        raise InvalidInput("nothing-to-pool", "Each of the values to combine needs a positive standard deviation.")
    v = [sd**2 for sd in sds]
    tau2 = 0.0
    if _residual_excess(values, v) > 0.0:
        low, high = 0.0, (max(values) - min(values)) ** 2 / (min(v) if scaled else 1.0)
        for _ in range(_STEPS):
            middle = 0.5 * (low + high)
            exceeds = _residual_excess(values, _widened(v, middle, scaled=scaled)) > 0.0
            low, high = (middle, high) if exceeds else (low, middle)
        tau2 = high
    widened = _widened(v, tau2, scaled=scaled)
    mu = _robust_mean(values, widened)
    weights = _robust_weights(values, widened, mu)
    total = math.fsum(weights)
    return Pooled(
        mean=mu,
        sd=1.0 / math.sqrt(total),
        excess_sd=math.sqrt(tau2),
        chi_squared=math.fsum((x - mu) ** 2 / own for x, own in zip(values, v, strict=True)),
        weights=tuple(weight / total for weight in weights),
    )


def _widened(v: Sequence[float], tau2: float, *, scaled: bool) -> list[float]:
    """Variances with the excess ``tau2``, added or as a factor."""
    return [own * (1.0 + tau2) if scaled else own + tau2 for own in v]


def _residual_excess(values: Sequence[float], v: Sequence[float]) -> float:
    """Sum of psi(z_i)^2 minus its expectation; decreases with the variances ``v``."""
    mu = _robust_mean(values, v)
    psi = (_huber_psi((x - mu) / math.sqrt(own)) for x, own in zip(values, v, strict=True))
    return math.fsum(one**2 for one in psi) - (len(values) - 1) * _EXPECTED


def _robust_mean(values: Sequence[float], v: Sequence[float]) -> float:
    """Root of the estimating equation, which is piecewise linear and decreasing in mu, by bracketed Newton steps."""
    sds = [math.sqrt(own) for own in v]
    low, high = min(values), max(values)
    mu = math.fsum(x / sd**2 for x, sd in zip(values, sds, strict=True)) / math.fsum(1.0 / sd**2 for sd in sds)
    for _ in range(_STEPS):
        z = [(x - mu) / sd for x, sd in zip(values, sds, strict=True)]
        score = math.fsum(_huber_psi(one) / sd for one, sd in zip(z, sds, strict=True))
        slope = math.fsum(1.0 / sd**2 for one, sd in zip(z, sds, strict=True) if abs(one) < C)
        low, high = (max(low, mu), high) if score > 0.0 else (low, min(high, mu))
        following = mu + score / slope if slope > 0.0 else math.inf
        if not low <= following <= high:
            following = 0.5 * (low + high)
        if abs(following - mu) <= 1e-15 * abs(mu):
            break
        mu = following
    return mu


def _robust_weights(values: Sequence[float], v: Sequence[float], mu: float) -> list[float]:
    """h_i w_i of each measurement."""
    weights = []
    for x, own in zip(values, v, strict=True):
        z = abs(x - mu) / math.sqrt(own)
        weights.append((C / z if z > C else 1.0) / own)
    return weights


def _huber_psi(z: float) -> float:
    return max(-C, min(C, z))
