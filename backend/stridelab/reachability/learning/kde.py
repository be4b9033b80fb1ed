"""Kernel density estimate of section 4.3.2.2, the reference density for a mixture.

    p(c) = 1/n sum_a N(c; x_a, h^2 I)        h = sigma n^(-1/7)

with one isotropic Gaussian kernel per sampled CoM. The bandwidth ``h`` is Scott's in three dimensions (Scott 1992,
"Multivariate Density Estimation"), ``sigma`` the mean of the samples' standard deviations along the three axes. A
divergence from this density depends on ``h``, so the two are stored together.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.spatial.distance import cdist
from scipy.special import logsumexp

from stridelab.conventions import Points, Series

CANDIDATES_M: Final = (0.01, 0.015, 0.02, 0.025, 0.03, 0.035, 0.04, 0.045, 0.05, 0.06, 0.07, 0.08, 0.1)
CHUNK: Final = 50
"""Points evaluated at once; with 20 000 kernels that is 8 MB."""


@dataclass(frozen=True, eq=False)
class KernelDensity:
    """``p(c)`` with kernels of standard deviation ``bandwidth_m`` at ``centres_m`` ``(n, 3)``."""

    centres_m: Points
    bandwidth_m: float

    @staticmethod
    def with_scott_bandwidth(centres_m: Points) -> "KernelDensity":
        """The density with Scott's bandwidth."""
        return KernelDensity(centres_m, scott_bandwidth_m(centres_m))

    def log_density(self, points_m: Points) -> Series:
        """``log p(c)`` (nats, density per m^3) at ``(n, 3)`` points."""
        log_p = np.empty(len(points_m))
        constant = -1.5 * np.log(2 * np.pi * self.bandwidth_m**2) - np.log(len(self.centres_m))
        for i in range(0, len(points_m), CHUNK):
            exponents = cdist(points_m[i : i + CHUNK], self.centres_m, "sqeuclidean")
            exponents *= -0.5 / self.bandwidth_m**2
            top = exponents.max(axis=1)
            exponents -= top[:, None]
            np.exp(exponents, out=exponents)
            log_p[i : i + CHUNK] = constant + top + np.log(exponents.sum(axis=1))
        return log_p

    def sample(self, n: int, rng: np.random.Generator) -> Points:
        """``n`` independent points ``(n, 3)``."""
        of = rng.integers(len(self.centres_m), size=n)
        return np.asarray(self.centres_m[of] + self.bandwidth_m * rng.standard_normal((n, 3)))


def held_out_bandwidth_m(clouds: Sequence[Points], candidates_m: Sequence[float] = CANDIDATES_M) -> float:
    """The candidate under which each point of all ``clouds`` is most likely given the others of its cloud.

    The likelihood is that of leaving one out, summed over the clouds ``(n, 3)``.
    """

    def log_likelihood(bandwidth_m: float) -> float:
        total = 0.0
        for cloud in clouds:
            exponents = -0.5 / bandwidth_m**2 * cdist(cloud, cloud, "sqeuclidean")
            np.fill_diagonal(exponents, -np.inf)
            constant = -1.5 * np.log(2 * np.pi * bandwidth_m**2) - np.log(len(cloud) - 1)
            total += float(logsumexp(exponents, axis=1).sum()) + len(cloud) * constant
        return total

    return max(candidates_m, key=log_likelihood)


def scott_bandwidth_m(points_m: Points) -> float:
    """``sigma n^(-1/7)`` of ``(n, 3)`` points."""
    return float(points_m.std(axis=0).mean() * len(points_m) ** (-1 / 7))
