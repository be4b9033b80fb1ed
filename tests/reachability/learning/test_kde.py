"""The kernel density against scikit-learn's, and against the moments that it must have."""

import numpy as np
import pytest
from sklearn.neighbors import KernelDensity as Oracle

from stridelab.reachability.learning.kde import CHUNK, KernelDensity, scott_bandwidth_m

CENTRES = np.random.default_rng(0).normal([0.2, -0.1, 0.7], [0.3, 0.1, 0.2], (700, 3))


@pytest.mark.parametrize("n", [1, CHUNK, CHUNK + 1, 3 * CHUNK - 7])
def test_log_density_is_that_of_scikit_learn(n: int) -> None:
    points = np.random.default_rng(1).normal(0.0, 0.8, (n, 3))
    # One leaf: where the density is tiny, the sums that its tree takes over whole branches are far off.
    oracle = Oracle(kernel="gaussian", bandwidth=0.05, leaf_size=len(CENTRES)).fit(CENTRES)
    np.testing.assert_allclose(
        KernelDensity(CENTRES, 0.05).log_density(points), oracle.score_samples(points), rtol=1e-12, atol=1e-10
    )


def test_scott_in_three_dimensions() -> None:
    """128 = 2^7 points: half of their standard deviation."""
    points = np.random.default_rng(2).normal(size=(128, 3))
    points = (points - points.mean(axis=0)) / points.std(axis=0) * [0.1, 0.2, 0.6]
    assert scott_bandwidth_m(points) == pytest.approx(0.15)
    assert KernelDensity.with_scott_bandwidth(points).bandwidth_m == pytest.approx(0.15)


def test_drawn_points_are_spread_by_the_kernel() -> None:
    n, h = 60_000, 0.2
    x = KernelDensity(CENTRES, h).sample(n, np.random.default_rng(3))
    centred = x - CENTRES.mean(axis=0)
    assert (np.abs(centred.mean(axis=0)) < 4 * x.std(axis=0) / np.sqrt(n)).all()
    squares = centred**2
    expected = CENTRES.var(axis=0) + h**2
    assert (np.abs(squares.mean(axis=0) - expected) < 4 * squares.std(axis=0) / np.sqrt(n)).all()
