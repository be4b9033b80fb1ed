"""The divergence of two Gaussians is known in closed form; the standard error is checked by repetition."""

import numpy as np
import pytest

from stridelab.reachability.gaussian_mixture import Mixture
from stridelab.reachability.learning.fit import Divergence, kl_divergences


def gaussian(mean: list[float], covariance: np.ndarray) -> Mixture:
    return Mixture(np.ones(1), np.array([mean]), covariance[None])


P = gaussian([0.1, 0.0, 0.6], np.diag([0.04, 0.02, 0.09]))
Q = gaussian([0.0, 0.1, 0.7], np.array([[0.05, 0.01, 0.0], [0.01, 0.03, 0.0], [0.0, 0.0, 0.06]]))


def exact(p: Mixture, q: Mixture) -> float:
    """KL of two Gaussians: (tr(Sq^-1 Sp) + d' Sq^-1 d - 3 + log det Sq / det Sp) / 2."""
    Sp, Sq, d = p.covariances_m2[0], q.covariances_m2[0], q.means_m[0] - p.means_m[0]
    trace, distance = np.trace(np.linalg.solve(Sq, Sp)), d @ np.linalg.solve(Sq, d)
    return float(0.5 * (trace + distance - 3 + np.linalg.slogdet(Sq)[1] - np.linalg.slogdet(Sp)[1]))


@pytest.mark.parametrize(("p", "q"), [(P, Q), (Q, P)])
def test_the_divergence_of_two_gaussians_is_the_exact_one(p: Mixture, q: Mixture) -> None:
    (divergence,) = kl_divergences(p, [q], 20_000, np.random.default_rng(0))
    assert abs(divergence.kl_nats - exact(p, q)) < 4 * divergence.kl_sd_nats
    assert divergence.kl_sd_nats < 0.03 * exact(p, q)


def test_the_standard_error_is_that_of_repeated_estimates() -> None:
    divergences = [kl_divergences(P, [Q], 200, np.random.default_rng(seed))[0] for seed in range(400)]
    spread = np.std([one.kl_nats for one in divergences], ddof=1)
    assert np.mean([one.kl_sd_nats for one in divergences]) == pytest.approx(spread, rel=0.15)
    bias = np.mean([one.kl_nats for one in divergences]) - exact(P, Q)
    assert abs(bias) < 4 * spread / np.sqrt(len(divergences))


def test_a_density_does_not_differ_from_itself() -> None:
    itself, other = kl_divergences(P, [P, Q], 100, np.random.default_rng(1))
    assert itself == Divergence(0.0, 0.0, 0.0)
    (alone,) = kl_divergences(P, [Q], 100, np.random.default_rng(1))
    assert (other.kl_nats, other.kl_sd_nats) == (alone.kl_nats, alone.kl_sd_nats), "all are measured by the same draws"
    assert other.excess_sd_nats == pytest.approx(other.kl_sd_nats)
    assert kl_divergences(P, [], 100, np.random.default_rng(1)) == []


def test_a_difference_has_a_smaller_error_than_its_terms() -> None:
    """By repetition: the standard error of the excess is that of the differences, not of either divergence."""
    near = gaussian([0.01, 0.1, 0.7], Q.covariances_m2[0])
    pairs = [kl_divergences(P, [Q, near], 200, np.random.default_rng(seed)) for seed in range(400)]
    spread = np.std([b.kl_nats - a.kl_nats for a, b in pairs], ddof=1)
    assert np.mean([max(a.excess_sd_nats, b.excess_sd_nats) for a, b in pairs]) == pytest.approx(spread, rel=0.15)
    assert spread < 0.2 * np.mean([a.kl_sd_nats for a, _ in pairs])
