"""Monte Carlo estimate of the Kullback-Leibler divergence (Hershey and Olsen 2007, equation 4).

    KL(p || q) = E_p[log p(x) - log q(x)]  ~  1/n sum_a log p(x_a) - log q(x_a),     x_a drawn from p

which is unbiased; its standard error is that of the mean.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from stridelab.conventions import Points, Series


@runtime_checkable
class Density(Protocol):
    """What can be evaluated."""

    def log_density(self, points_m: Points, /) -> Series:
        """``log p`` at ``(n, 3)`` points."""
        ...


@runtime_checkable
class Drawable(Density, Protocol):
    """What can also be drawn from."""

    def sample(self, n: int, rng: np.random.Generator, /) -> Points:
        """``n`` independent points."""
        ...


@dataclass(frozen=True)
class Divergence:
    """``KL(p || q)`` and the standard error of its estimate, in nats."""

    kl_nats: float
    kl_sd_nats: float


def divergences(p: Drawable, qs: Sequence[Density], draws: int, rng: np.random.Generator) -> list[Divergence]:
    """``KL(p || q)`` of every ``q``, all from the same draws, so that they compare better than each is known."""
    x = p.sample(draws, rng)
    log_p = p.log_density(x)
    found = []
    for q in qs:
        ratio = log_p - q.log_density(x)
        found.append(Divergence(float(ratio.mean()), float(ratio.std(ddof=1) / np.sqrt(draws))))
    return found
