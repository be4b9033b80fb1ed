"""Correlations against scipy, closed forms, and what repeated sampling says of their intervals."""

import numpy as np
import pytest
import scipy.stats
from hypothesis import given, settings
from hypothesis import strategies as st

from stridelab.walking.population.correlations import (
    MIN_SUBJECTS,
    bootstrap_indices,
    fisher_interval,
    holm_correction,
    partial_correlation,
    pearson,
    spearman,
    two_sided_p,
)


def people(n: int, seed: int, rho: float = 0.5) -> tuple[np.ndarray, np.ndarray]:
    x, e = np.random.default_rng(seed).normal(size=(2, n))
    return 1.7 + 0.07 * x, 0.1 + 0.01 * (rho * x + np.sqrt(1 - rho**2) * e)


@pytest.mark.parametrize("n", [4, 5, 11, 40])
def test_pearson_is_that_of_scipy(n: int) -> None:
    x, y = people(n, seed=n)
    ours, theirs = pearson(x, y), scipy.stats.pearsonr(x, y)
    assert ours is not None
    assert ours.r == pytest.approx(theirs.statistic, abs=1e-12)
    assert ours.p == pytest.approx(theirs.pvalue, rel=1e-9)
    assert ours.ci95 == pytest.approx(tuple(theirs.confidence_interval(0.95)), abs=1e-9)


@pytest.mark.parametrize("n", [4, 11, 40])
def test_spearman_is_that_of_scipy_with_ties(n: int) -> None:
    x, y = people(n, seed=100 + n)
    x, y = x.round(1 if n > 4 else 3), y.round(2 if n > 4 else 4)
    ours, theirs = spearman(x, y), scipy.stats.spearmanr(x, y)
    assert ours is not None
    assert ours.r == pytest.approx(theirs.statistic, abs=1e-12)
    assert ours.p == pytest.approx(theirs.pvalue, rel=1e-9)


@pytest.mark.parametrize("kind", ["pearson", "spearman"])
def test_the_bootstrap_interval_is_that_of_scipy(kind: str) -> None:
    x, y = people(16, seed=3, rho=0.7)
    ours = (pearson if kind == "pearson" else spearman)(x, y, draws=bootstrap_indices(16, seed=1, count=20000))
    statistic = {"pearson": scipy.stats.pearsonr, "spearman": scipy.stats.spearmanr}[kind]

    def coefficient(a: np.ndarray, b: np.ndarray) -> float:
        return float(statistic(a, b).statistic)

    theirs = scipy.stats.bootstrap(
        (x, y), coefficient, paired=True, vectorized=False, n_resamples=5000, method="BCa", rng=np.random.default_rng(2)
    )
    assert ours is not None
    assert ours.bootstrap_ci95 == pytest.approx(tuple(theirs.confidence_interval), abs=0.025)


def test_the_same_seed_gives_the_same_interval() -> None:
    x, y = people(11, seed=5)
    once, again, other = (pearson(x, y, draws=bootstrap_indices(11, seed=s)) for s in (7, 7, 8))
    assert once is not None
    assert other is not None
    assert once == again
    assert once.bootstrap_ci95 != other.bootstrap_ci95


def test_partial_is_the_closed_form_for_one_variable_held_fixed() -> None:
    x, y = people(20, seed=1)
    z = 0.5 * x + 0.3 * np.random.default_rng(9).normal(size=20)
    (_, xy, xz), (_, _, yz), _ = np.corrcoef([x, y, z])
    expected = (xy - xz * yz) / np.sqrt((1 - xz**2) * (1 - yz**2))
    correlation = partial_correlation(x, y, z[:, None])
    assert correlation is not None
    assert correlation.r == pytest.approx(expected, abs=1e-12)
    assert correlation.controlled == 1
    half = scipy.stats.norm.ppf(0.975) / np.sqrt(20 - 3 - 1)
    assert correlation.ci95 == pytest.approx(
        (np.tanh(np.arctanh(expected) - half), np.tanh(np.arctanh(expected) + half))
    )
    t = expected * np.sqrt((20 - 3) / (1 - expected**2))
    assert correlation.p == pytest.approx(2 * scipy.stats.t.sf(abs(t), 20 - 3))


def test_partial_is_the_precision_matrix_for_several() -> None:
    rng = np.random.default_rng(4)
    data = rng.normal(size=(30, 5)) @ rng.normal(size=(5, 5))
    precision = np.linalg.inv(np.cov(data.T))
    correlation = partial_correlation(data[:, 0], data[:, 1], data[:, 2:])
    assert correlation is not None
    assert correlation.r == pytest.approx(-precision[0, 1] / np.sqrt(precision[0, 0] * precision[1, 1]), abs=1e-9)


def test_a_correlation_through_a_third_variable_disappears_when_it_is_held_fixed() -> None:
    rng = np.random.default_rng(0)
    z = rng.normal(size=4000)
    x, y = z + rng.normal(size=4000), z + rng.normal(size=4000)
    plain, partial = pearson(x, y), partial_correlation(x, y, z[:, None])
    assert plain is not None
    assert partial is not None
    assert plain.r == pytest.approx(0.5, abs=0.05)
    assert partial.ci95 is not None
    assert partial.ci95[0] < 0.0 < partial.ci95[1]


@pytest.mark.parametrize(("rho", "k"), [(0.0, 0), (0.67, 0), (0.87, 0), (0.6, 2)])
def test_fisher_intervals_cover_the_truth_at_n_11(rho: float, k: int) -> None:
    rng, inside, trials = np.random.default_rng(11), 0, 2000
    for _ in range(trials):
        controls = rng.normal(size=(11, k))
        x, e = rng.normal(size=(2, 11))
        y = rho * x + np.sqrt(1 - rho**2) * e
        shift = controls.sum(axis=1) if k else 0.0
        correlation = partial_correlation(x + shift, y - shift, controls) if k else pearson(x, y)
        assert correlation is not None
        assert correlation.ci95 is not None
        inside += correlation.ci95[0] <= rho <= correlation.ci95[1]
    assert 0.935 <= inside / trials <= 0.965


def test_the_bootstrap_interval_does_not_depend_on_the_order_of_the_subjects() -> None:
    """Samples that are permutations of all subjects have their coefficient, but for rounding, which order changes."""
    draws = bootstrap_indices(8, seed=1)
    for seed in range(20):
        rng = np.random.default_rng(seed)
        x = rng.normal(size=8)
        y, order = 0.5 * x + rng.normal(size=8), rng.permutation(8)
        given, other = pearson(x, y, draws=draws), pearson(x[order], y[order], draws=np.argsort(order)[draws])
        assert given is not None
        assert other is not None
        assert given.bootstrap_ci95 == pytest.approx(other.bootstrap_ci95, abs=1e-9)


def test_bootstrap_intervals_cover_the_truth_but_for_few_people_less_often_than_they_say() -> None:
    rng = np.random.default_rng(12)
    cover = {}
    for n in (11, 40):
        draws, inside = bootstrap_indices(n, seed=0, count=500), 0
        for _ in range(400):
            x, e = rng.normal(size=(2, n))
            correlation = pearson(x, 0.6 * x + 0.8 * e, draws=draws)
            assert correlation is not None
            assert correlation.bootstrap_ci95 is not None
            inside += correlation.bootstrap_ci95[0] <= 0.6 <= correlation.bootstrap_ci95[1]
        cover[n] = inside / 400
    assert 0.85 <= cover[11] <= 0.96
    assert 0.90 <= cover[40] <= 0.975


def test_holm_gives_what_was_computed_by_hand() -> None:
    assert holm_correction(np.array([0.04, 0.01, 0.03, 0.5])) == pytest.approx([0.09, 0.04, 0.09, 0.5])
    assert holm_correction(np.array([0.9, 0.8])) == pytest.approx([1.0, 1.0])


@pytest.mark.parametrize("n", [1, 2, MIN_SUBJECTS - 1])
def test_too_few_people_have_no_correlation(n: int) -> None:
    assert pearson(np.arange(n) * 1.0, np.arange(n) * 2.0) is None
    assert spearman(np.arange(n) * 1.0, np.arange(n) * 2.0) is None


def test_a_constant_has_no_correlation() -> None:
    x, flat = np.array([1.6, 1.7, 1.8, 1.9, 2.0]), np.full(5, 0.1)
    assert pearson(x, flat) is None
    assert partial_correlation(x, flat, np.arange(5.0)[:, None]) is None


def test_nothing_is_left_when_a_variable_is_held_fixed_itself() -> None:
    x, y = people(11, seed=2)
    assert partial_correlation(x, y, 3.0 * x[:, None] - 1.0) is None


def test_a_perfect_line_has_no_width_and_p_0() -> None:
    x = np.arange(6.0)
    correlation = pearson(x, 2.0 * x + 1.0, draws=bootstrap_indices(6, seed=0))
    assert correlation is not None
    assert correlation.r == pytest.approx(1.0)
    assert correlation.p == 0.0
    assert correlation.bootstrap_ci95 == pytest.approx((1.0, 1.0))


def test_no_interval_without_a_degree_of_freedom() -> None:
    assert fisher_interval(0.5, 4, controlled=1) is None
    correlation = partial_correlation(*people(4, seed=1), np.random.default_rng(0).normal(size=(4, 1)))
    assert correlation is not None
    assert correlation.ci95 is None
    assert 0.0 <= correlation.p <= 1.0


@settings(max_examples=50, deadline=None)
@given(r=st.floats(-0.999, 0.999), n=st.integers(5, 500))
def test_p_and_interval_agree_on_zero_about(r: float, n: int) -> None:
    low, high = fisher_interval(r, n) or (np.nan, np.nan)
    assert low <= r <= high
    p = two_sided_p(r, n - 2)
    if p > 0.10:
        assert low < 0.0 < high
    if p < 0.02:
        assert not low < 0.0 < high
