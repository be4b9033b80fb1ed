"""Where an effector lets the CoM be, from its learned density: as a box for linear programmes, as a share to report.

The box holds, along each axis of the density's frame, all but the rarest of its mass,

    P(y_a < low_a) = P(y_a > high_a) = (1 - share) / 2,      P(y_a < x) = sum_j w_j Phi((x - mu_ja) / S_jaa^(1/2))

The share of a point c says how unusual it is among the postures that were learned: ``P(p(Y) <= p(c))`` for Y of the
density itself, 1 at its mode and 0 far out. It needs no unit, and two effectors can be compared by it.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.optimize import brentq
from scipy.special import ndtr

from stridelab.conventions import Points, Series, Vector3
from stridelab.reachability.gaussian_mixture import Mixture

SHARE = 0.999
"""Of the mass along each axis that lies in the box."""
SAMPLES = 4000
"""The share of a point is a multiple of one over this many."""
FAR_SD = 12.0


@dataclass(frozen=True, eq=False)
class Box:
    """Corners (m) in the density's frame."""

    low_m: Vector3
    high_m: Vector3


@lru_cache(maxsize=32)
def reach_box(mixture: Mixture, share: float = SHARE) -> Box:
    """The box of a density."""
    rare = (1.0 - share) / 2.0
    ends = np.array([[_quantile(mixture, axis, q) for axis in range(3)] for q in (rare, 1.0 - rare)])
    return Box(ends[0], ends[1])


def usual_share(mixture: Mixture, points_m: Points) -> Series:
    """The share of every point ``(n, 3)`` given in the density's frame."""
    known = _sorted_densities(mixture)
    return np.searchsorted(known, mixture.log_density(points_m), side="right") / len(known)


@lru_cache(maxsize=32)
def _sorted_densities(mixture: Mixture) -> Series:
    samples_m = mixture.sample(SAMPLES, np.random.default_rng(0))
    return np.sort(mixture.log_density(samples_m))


def _quantile(mixture: Mixture, axis: int, q: float) -> float:
    mu, sd = mixture.means_m[:, axis], np.sqrt(mixture.covariances_m2[:, axis, axis])

    def missing(x: float) -> float:
        return float(mixture.weights @ ndtr((x - mu) / sd)) - q

    return float(brentq(missing, float((mu - FAR_SD * sd).min()), float((mu + FAR_SD * sd).max())))
