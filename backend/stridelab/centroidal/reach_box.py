"""CoM reach of an effector from its learned density: a box for linear programs and a share for reports.

The box contains, along each axis of the density's frame, all but the tails of its mass,

    P(y_a < low_a) = P(y_a > high_a) = (1 - share) / 2,      P(y_a < x) = sum_j w_j Phi((x - mu_ja) / S_jaa^(1/2))

The share of a point c measures how unusual it is among the learned postures: ``P(p(Y) <= p(c))`` for Y distributed by
the density, 1 at its mode and 0 far out. It is dimensionless and comparable between effectors.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.optimize import brentq
from scipy.special import ndtr

from stridelab.conventions import Points, Series, Vector3
from stridelab.reachability.gaussian_mixture import Mixture

BOX_MASS_SHARE = 0.999
"""Share of the mass along each axis inside the box."""
SAMPLES = 4000
"""Samples for the share of a point, which is a multiple of 1 / ``SAMPLES``."""
FAR_SD = 12.0


@dataclass(frozen=True, eq=False)
class Box:
    """Corners (m) in the density's frame."""

    low_m: Vector3
    high_m: Vector3


@lru_cache(maxsize=32)
def reach_box(mixture: Mixture, share: float = BOX_MASS_SHARE) -> Box:
    """Compute the reach box of a density."""
    tail = (1.0 - share) / 2.0
    ends = np.array([[_marginal_quantile(mixture, axis, q) for axis in range(3)] for q in (tail, 1.0 - tail)])
    return Box(ends[0], ends[1])


def usual_share(mixture: Mixture, points_m: Points) -> Series:
    """Share of every point ``(n, 3)`` in the density's frame."""
    densities = _sorted_densities(mixture)
    return np.searchsorted(densities, mixture.log_density(points_m), side="right") / len(densities)


@lru_cache(maxsize=32)
def _sorted_densities(mixture: Mixture) -> Series:
    samples_m = mixture.sample(SAMPLES, np.random.default_rng(0))
    return np.sort(mixture.log_density(samples_m))


def _marginal_quantile(mixture: Mixture, axis: int, q: float) -> float:
    mu, sd = mixture.means_m[:, axis], np.sqrt(mixture.covariances_m2[:, axis, axis])

    def cdf_difference(x: float) -> float:
        return float(mixture.weights @ ndtr((x - mu) / sd)) - q

    return float(brentq(cdf_difference, float((mu - FAR_SD * sd).min()), float((mu + FAR_SD * sd).max())))
