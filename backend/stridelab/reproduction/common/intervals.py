"""95 % intervals of numbers that stand on a sample: one bootstrap, and the binomial interval of a share.

Draws of the noise, people, steps and contact sets are resampled alike: ``RESAMPLES`` samples of as many, drawn with
replacement. A statistic that most depends on one case, such as a maximum, has no such interval; for a claim on every
case it is the share of cases that has one (``share_interval``).
"""

from collections.abc import Callable, Sequence

import numpy as np
from scipy.stats import beta

from stridelab.conventions import Series
from stridelab.walking.population.correlations import bootstrap_indices

Interval = tuple[float, float]


def resampled_interval(statistic: Callable[[Sequence[int]], float], n: int) -> Interval | None:
    """95 % interval of a statistic of the chosen draws or people, by bootstrap; None for a single one.

    ``statistic`` takes ``n`` numbers below ``n``, in which some occur repeatedly and some are missing.
    """
    if n < 2:
        return None
    values = [statistic(chosen) for chosen in bootstrap_indices(n, seed=0).tolist()]
    low, high = np.percentile(values, (2.5, 97.5)).tolist()
    return low, high


def interval_of(values: Sequence[float] | Series, statistic: Callable[[Series], float] = np.mean) -> Interval | None:
    """``resampled_interval`` of a statistic of one number per draw, person or step, by default the mean."""
    given = np.asarray(values, dtype=float)
    return resampled_interval(lambda chosen: float(statistic(given[chosen])), len(given))


def rms_ratio(ours: Sequence[float] | Series, other: Sequence[float] | Series) -> tuple[float, Interval | None]:
    """Root of the mean of squares over that of others, of the same people, and its interval over the people.

    A penalty may make the squares of ours negative; the root of a negative mean is zero.
    """
    pairs = np.array([ours, other])

    def root_ratio(chosen: Sequence[int]) -> float:
        mean, of_other = pairs[:, chosen].mean(axis=1).tolist()
        return float(np.sqrt(max(mean, 0.0) / of_other))

    n = pairs.shape[1]
    return root_ratio(range(n)), resampled_interval(root_ratio, n)


def share_interval(count: int, n: int, tail: float = 0.025) -> Interval:
    """Interval of a share that ``count`` of ``n`` cases have (Clopper and Pearson 1934); 95 % by default.

    ``tail`` is the probability that it misses the share on one side.
    """
    low = float(beta.ppf(tail, count, n - count + 1)) if count > 0 else 0.0
    high = float(beta.isf(tail, count + 1, n - count)) if count < n else 1.0
    return low, high
