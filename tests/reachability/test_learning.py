"""EM finds a mixture that is known; the card's numbers are those of the samples."""

import numpy as np
import pytest
from sklearn.neighbors import KernelDensity as Oracle

from stridelab.errors import InvalidInput, NotFound
from stridelab.reachability.density import scott_bandwidth_m
from stridelab.reachability.divergence import divergences
from stridelab.reachability.learning import (
    COMPONENTS,
    HELD_OUT,
    KL_DRAWS,
    SIZES,
    expectation_maximisation,
    fit,
    learn,
)
from stridelab.reachability.mixture import Mixture
from stridelab.reachability.sampling import ComCloud
from stridelab.robots.robot import Robot

TRUTH = Mixture(
    np.array([0.5, 0.3, 0.2]),
    np.array([[0.0, 0.1, 0.7], [0.5, 0.0, 0.4], [-0.5, -0.2, 0.3]]),
    np.array([np.diag([0.02, 0.01, 0.005]), np.diag([0.01, 0.01, 0.01]), np.diag([0.005, 0.02, 0.01])]),
)


def test_em_finds_a_known_mixture() -> None:
    found, converged = expectation_maximisation(TRUTH.sample(20_000, np.random.default_rng(0)), 3, seed=0)
    order = np.argsort(-found.weights)
    assert converged
    np.testing.assert_allclose(found.weights[order], TRUTH.weights, atol=0.02)
    np.testing.assert_allclose(found.means_m[order], TRUTH.means_m, atol=0.01)
    np.testing.assert_allclose(found.covariances_m2[order], TRUTH.covariances_m2, atol=0.002)
    (kl,) = divergences(TRUTH, [found], 5000, np.random.default_rng(1))
    assert kl.kl_nats < 0.005


def test_em_that_runs_out_of_steps_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("stridelab.reachability.learning.STEPS_MAX", 1)
    _, converged = expectation_maximisation(TRUTH.sample(500, np.random.default_rng(0)), 5, seed=0)
    assert not converged


def test_the_numbers_of_a_card_are_those_of_the_samples(fresh: ComCloud) -> None:
    x = fresh.com_m["left_foot"]
    card = fit(x, 7, seed=1, sizes=(1, 3))
    mixture = card.mixture()
    seen, held_out = x[: -len(x) // HELD_OUT], x[-len(x) // HELD_OUT :]
    assert card.held_out_log_likelihood == pytest.approx(mixture.log_density(held_out).mean())
    assert card.held_out_log_likelihood_sd == pytest.approx(mixture.log_density(held_out).std() / 20, rel=0.01)
    again, _ = expectation_maximisation(seen, 7, seed=1)
    assert (again.means_m == mixture.means_m).all(), "EM saw nothing of what is held out"
    other, _ = expectation_maximisation(seen, 7, seed=2)
    assert (other.means_m != mixture.means_m).all(), "the seed is used"
    assert [trial.components for trial in card.sizes] == [1, 3, 7]
    assert card.sizes[2].kl_nats == card.kl_nats
    assert card.sizes[0].kl_nats > card.sizes[1].kl_nats
    assert card.reach.com_low_m == pytest.approx(np.percentile(x, 0.5, axis=0))
    assert card.reach.com_high_m == pytest.approx(np.percentile(x, 99.5, axis=0))
    assert card.reach.com_distance_max_m == pytest.approx(np.sqrt((x**2).sum(axis=1)).max())
    assert card.mode_log_density >= mixture.log_density(x).max()


def test_the_divergence_is_from_the_kernel_density_of_the_samples(fresh: ComCloud) -> None:
    """Estimated anew: scikit-learn's kernels, draws of this test's own."""
    x = fresh.com_m["right_hand"]
    card = fit(x, 14, seed=0, sizes=())
    assert card.bandwidth_m == scott_bandwidth_m(x)
    rng = np.random.default_rng(99)
    draws = x[rng.integers(len(x), size=KL_DRAWS)] + card.bandwidth_m * rng.standard_normal((KL_DRAWS, 3))
    kde = Oracle(bandwidth=card.bandwidth_m, leaf_size=len(x)).fit(x)
    ratio = kde.score_samples(draws) - card.mixture().log_density(draws)
    error = np.hypot(card.kl_sd_nats, ratio.std() / np.sqrt(KL_DRAWS))
    assert abs(ratio.mean() - card.kl_nats) < 4 * error


def test_too_many_components_for_few_samples_show_in_what_is_held_out(fresh: ComCloud) -> None:
    card = fit(fresh.com_m["left_foot"][:250], 20, seed=0, sizes=(3,))
    three, twenty = (trial.held_out_log_likelihood for trial in card.sizes)
    assert twenty < three


def test_a_robot_is_learned_from_its_postures(talos: Robot) -> None:
    told: list[float] = []
    learned = learn(talos, ["right_hand", "left_foot"], 300, seed=5, progress=lambda f, _: told.append(f), sizes=(1, 2))
    card = learned.card
    assert (card.robot, card.robot_sha256, card.seed) == ("talos", talos.sha256, 5)
    assert (card.samples, card.fitted, card.tried) == (300, 240, learned.cloud.tried)
    assert list(card.effectors) == ["right_hand", "left_foot"]
    assert card.effectors["left_foot"].components == COMPONENTS["surface"] == 7
    assert card.effectors["right_hand"].components == COMPONENTS["point"] == 14
    assert [pair.effectors for pair in card.pairs] == [("right_hand", "left_foot")]
    assert card.versions["scikit-learn"]
    assert told == sorted(told)
    assert 0.0 <= told[0] <= told[-1] <= 1.0
    again = learn(talos, ["right_hand", "left_foot"], 300, seed=5, sizes=(1, 2))
    assert again.card == card, "the seed decides"
    other = learn(talos, ["left_foot"], 300, seed=6, sizes=()).card
    assert other.effectors["left_foot"].means != card.effectors["left_foot"].means


def test_the_default_is_all_effectors(talos: Robot) -> None:
    card = learn(talos, samples=100, measure="conditioned", sizes=()).card
    assert list(card.effectors) == list(talos.effectors)
    assert card.measure == "conditioned"
    assert max(SIZES) <= 100 - 100 // HELD_OUT, "the curve can be fitted to the least number of samples"


def test_what_cannot_be_learned_is_refused(talos: Robot) -> None:
    with pytest.raises(InvalidInput) as too_few:
        learn(talos, ["left_foot"], 99)
    assert too_few.value.code == "too-few-samples"
    with pytest.raises(NotFound) as unknown:
        learn(talos, ["left_foot", "tail"], 500)
    assert unknown.value.faults[0].where == "effectors[1]"
