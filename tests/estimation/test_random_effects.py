"""Several measurements of one quantity: against closed forms, an independent root finder, and simulated sessions."""

import itertools
import math

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.stats import norm

from stridelab.errors import InvalidInput
from stridelab.estimation.random_effects import C, pool_measurements

E_PSI2 = float(norm.expect(lambda z: min(z**2, C**2)))


def test_measurements_that_agree_have_the_inverse_variance_mean() -> None:
    x, sd = [10.1, 9.9, 10.0], [0.5, 1.0, 2.0]
    w = [1 / s**2 for s in sd]
    result = pool_measurements(x, sd)
    assert result.mean == pytest.approx(np.average(x, weights=w), abs=1e-12)
    assert result.sd == pytest.approx(1 / math.sqrt(sum(w)), rel=1e-12)
    assert result.excess_sd == 0.0
    assert result.weights == pytest.approx([one / sum(w) for one in w])
    assert result.n == 3


def test_one_measurement_is_itself() -> None:
    result = pool_measurements([3.0], [0.2])
    assert (result.mean, result.sd, result.excess_sd, result.weights) == (3.0, pytest.approx(0.2), 0.0, (1.0,))


def test_two_measurements_that_contradict_each_other_have_the_excess_of_the_estimating_equation() -> None:
    """For z = +-d / (2 sqrt(v + tau^2)) < C the equation is d^2 / (2 (v + tau^2)) = E psi^2."""
    result = pool_measurements([0.0, 4.0], [1.0, 1.0])
    assert result.mean == pytest.approx(2.0, abs=1e-9)
    assert result.excess_sd**2 == pytest.approx(4.0**2 / (2 * E_PSI2) - 1.0, rel=1e-9)
    assert result.sd == pytest.approx(math.sqrt((1.0 + result.excess_sd**2) / 2), rel=1e-9)


def test_the_result_solves_both_equations() -> None:
    x, v = np.array([17.0, 18.5, 38.0, 16.0, 21.5, 19.0]), np.array([1.0, 0.7, 5.0, 2.0, 1.4, 0.9]) ** 2

    def mean(tau2: float) -> float:
        sd = np.sqrt(v + tau2)
        return float(brentq(lambda m: np.sum(np.clip((x - m) / sd, -C, C) / sd), x.min(), x.max(), xtol=1e-13))

    def residuals(tau2: float) -> float:
        z = (x - mean(tau2)) / np.sqrt(v + tau2)
        return float(np.sum(np.clip(z, -C, C) ** 2) - (len(x) - 1) * E_PSI2)

    tau2 = brentq(residuals, 0.0, 1e3, xtol=1e-13)
    result = pool_measurements(x.tolist(), np.sqrt(v).tolist())
    assert result.excess_sd == pytest.approx(math.sqrt(tau2), rel=1e-6)
    assert result.mean == pytest.approx(mean(tau2), abs=1e-8)


def test_the_order_does_not_matter_to_the_last_bit() -> None:
    pairs = [(17.31, 1.35), (17.52, 0.93), (38.61, 7.74), (30.56, 4.82), (13.16, 1.92)]
    result = set()
    for order in itertools.permutations(pairs):
        pooled = pool_measurements([x for x, _ in order], [sd for _, sd in order])
        result.add((pooled.mean, pooled.sd, pooled.excess_sd))
    assert len(result) == 1


def test_an_outlier_moves_the_mean_no_further_however_far_it_lies() -> None:
    rest, sd = [17.0, 17.5, 18.0, 17.2, 17.8, 18.3, 16.9], [1.0] * 8
    clean = pool_measurements(rest, sd[:-1])
    near, far = (pool_measurements([*rest, outlier], sd) for outlier in (60.0, 6000.0))
    assert far.mean == pytest.approx(near.mean, abs=0.05)
    assert abs(far.mean - clean.mean) < clean.sd * 1.5
    assert abs(np.mean([*rest, 60.0]) - clean.mean) > 10 * clean.sd, "where the plain mean goes"
    assert far.weights[-1] < 0.01


@pytest.mark.parametrize(("excess", "low", "high"), [(0.0, 0.6, 1.1), (3.0, 0.8, 1.4)])
def test_the_stated_deviation_holds_over_simulated_sessions(excess: float, low: float, high: float) -> None:
    """Without excess some is estimated by chance, none is ever negative, and the deviation is a little too large."""
    rng = np.random.default_rng(20)
    z = []
    for _ in range(400):
        sd = rng.uniform(0.7, 2.5, 8)
        x = 17.5 + rng.normal(0, np.hypot(sd, excess))
        result = pool_measurements(x.tolist(), sd.tolist())
        z.append((result.mean - 17.5) / result.sd)
    assert low < np.mean(np.square(z)) < high


@pytest.mark.parametrize(("values", "sds"), [([], []), ([1.0], []), ([1.0], [0.0]), ([1.0, 2.0], [1.0, -1.0])])
def test_what_cannot_be_pooled_is_refused(values: list[float], sds: list[float]) -> None:
    with pytest.raises(InvalidInput) as refusal:
        pool_measurements(values, sds)
    assert refusal.value.code == "nothing-to-pool"


def test_scaled_errors_keep_the_ratio_of_the_weights() -> None:
    """Equal errors give the same mean either way; of unequal ones the factor keeps what the added variance levels."""
    added, scaled = (pool_measurements([0.0, 4.0], [1.0, 1.0], scaled=way) for way in (False, True))
    assert (scaled.mean, scaled.sd) == (pytest.approx(added.mean, abs=1e-9), pytest.approx(added.sd, rel=1e-9))
    assert scaled.excess_sd == pytest.approx(added.excess_sd, rel=1e-9)
    x, sd = [0.0, 0.5, 1.5, -1.0], [0.1, 0.2, 0.2, 0.4]
    result = pool_measurements(x, sd, scaled=True)
    s2 = 1.0 + result.excess_sd**2
    h = [min(1.0, C * one * math.sqrt(s2) / abs(a - result.mean)) for a, one in zip(x, sd, strict=True)]
    w = np.array([a / one**2 for a, one in zip(h, sd, strict=True)])
    assert result.weights == pytest.approx(w / w.sum(), rel=1e-6)
    assert result.sd == pytest.approx(math.sqrt(s2 / w.sum()), rel=1e-6)
    assert s2 > 2.0
