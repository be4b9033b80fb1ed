"""Monte Carlo estimate of the Kullback-Leibler divergence (Hershey and Olsen 2007, equation 4).

    KL(p || q) = E_p[log p(x) - log q(x)]  ~  1/n sum_a log p(x_a) - log q(x_a),     x_a drawn from p

which is unbiased; its standard error is that of the mean. The difference between the divergences of two q from the same
draws is E_p[log q'(x) - log q(x)], whose estimate is much more accurate than either, since log p cancels.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from stridelab.conventions import Points, Series


@runtime_checkable
class Density(Protocol):
    """A density that can be evaluated."""

    def log_density(self, points_m: Points, /) -> Series:
        """``log p`` at ``(n, 3)`` points."""
        ...


@runtime_checkable
class SampledDensity(Density, Protocol):
    """A density that can also be sampled."""

    def sample(self, n: int, rng: np.random.Generator, /) -> Points:
        """``n`` independent points."""
        ...


@dataclass(frozen=True)
class Divergence:
    """``KL(p || q)`` and the standard error of its estimate, in nats.

    ``excess_sd_nats`` is the standard error of its difference from the smallest one of the same call.
    """

    kl_nats: float
    kl_sd_nats: float
    excess_sd_nats: float


def kl_divergences(p: SampledDensity, qs: Sequence[Density], draws: int, rng: np.random.Generator) -> list[Divergence]:
    """``KL(p || q)`` of every ``q``, all from the same draws."""
    if not qs:
        return []
    x = p.sample(draws, rng)
    log_q = np.array([q.log_density(x) for q in qs])
    ratio = p.log_density(x) - log_q
    kl = ratio.mean(axis=1)
    excess = log_q[kl.argmin()] - log_q
    kl_sd, excess_sd = (values.std(axis=1, ddof=1) / np.sqrt(draws) for values in (ratio, excess))
    return [Divergence(*numbers) for numbers in zip(kl.tolist(), kl_sd.tolist(), excess_sd.tolist(), strict=True)]
