"""EM finds a mixture that is known; the card's numbers are those of the samples."""

import builtins
from dataclasses import replace
from datetime import date
from typing import Any

import numpy as np
import pytest
from sklearn.neighbors import KernelDensity as Oracle

from stridelab.errors import InvalidInput, NotFound
from stridelab.reachability.card import EffectorCard
from stridelab.reachability.gaussian_mixture import Mixture
from stridelab.reachability.learning.com_sampling import ComCloud
from stridelab.reachability.learning.fit import (
    HELD_OUT_RECIPROCAL,
    KL_DRAWS,
    SIZES,
    Divergence,
    expectation_maximisation,
    fit,
    kl_divergences,
    learn_densities,
    prepare_fits,
    select_size,
)
from stridelab.reachability.learning.kde import scott_bandwidth_m
from stridelab.robots.robot import Robot

DAY = date(2026, 11, 21)
TRUTH = Mixture(
    np.array([0.5, 0.3, 0.2]),
    np.array([[0.0, 0.1, 0.7], [0.5, 0.0, 0.4], [-0.5, -0.2, 0.3]]),
    np.array([np.diag([0.02, 0.01, 0.005]), np.diag([0.01, 0.01, 0.01]), np.diag([0.005, 0.02, 0.01])]),
)


def test_em_finds_a_known_mixture() -> None:
    mixture, converged = expectation_maximisation(TRUTH.sample(20_000, np.random.default_rng(0)), 3, seed=0)
    order = np.argsort(-mixture.weights)
    assert converged
    np.testing.assert_allclose(mixture.weights[order], TRUTH.weights, atol=0.02)
    np.testing.assert_allclose(mixture.means_m[order], TRUTH.means_m, atol=0.01)
    np.testing.assert_allclose(mixture.covariances_m2[order], TRUTH.covariances_m2, atol=0.002)
    (kl,) = kl_divergences(TRUTH, [mixture], 5000, np.random.default_rng(1))
    assert kl.kl_nats < 0.005


def test_em_that_runs_out_of_iterations_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("stridelab.reachability.learning.fit.STEPS_MAX", 1)
    _, converged = expectation_maximisation(TRUTH.sample(500, np.random.default_rng(0)), 5, seed=0)
    assert not converged


@pytest.fixture(scope="module")
def foot(fresh: ComCloud) -> EffectorCard:
    return fit(fresh.com_m["left_foot"], "surface", "contact", seed=1)


def test_the_numbers_of_a_card_are_those_of_the_samples(fresh: ComCloud, foot: EffectorCard) -> None:
    x, card = fresh.com_m["left_foot"], foot
    mixture = card.to_mixture()
    training, held_out = x[: -len(x) // HELD_OUT_RECIPROCAL], x[-len(x) // HELD_OUT_RECIPROCAL :]
    assert card.held_out_log_likelihood == pytest.approx(mixture.log_density(held_out).mean())
    assert card.held_out_log_likelihood_sd == pytest.approx(mixture.log_density(held_out).std() / 20, rel=0.01)
    again, _ = expectation_maximisation(training, card.components, seed=1)
    assert (again.means_m == mixture.means_m).all(), "EM saw nothing of what is held out"
    other, _ = expectation_maximisation(training, card.components, seed=2)
    assert (other.means_m != mixture.means_m).all(), "the seed is used"
    assert [trial.components for trial in card.sizes] == list(range(1, 21)) == list(SIZES)
    assert card.sizes[card.components - 1].kl_nats == card.kl_nats
    assert (card.thesis_components, card.frame) == (7, "contact")
    assert card.sizes[0].kl_nats > card.sizes[1].kl_nats > card.kl_nats
    assert card.reach.com_low_m == pytest.approx(np.percentile(x, 0.5, axis=0))
    assert card.reach.com_high_m == pytest.approx(np.percentile(x, 99.5, axis=0))
    assert card.reach.com_distance_max_m == pytest.approx(np.sqrt((x**2).sum(axis=1)).max())
    assert card.mode_log_density >= mixture.log_density(x).max()


def test_the_divergence_is_from_the_kernel_density_of_the_samples(fresh: ComCloud, foot: EffectorCard) -> None:
    """Estimated anew: scikit-learn's kernels, draws of this test's own."""
    x = fresh.com_m["left_foot"]
    assert foot.bandwidth_m == scott_bandwidth_m(x)
    rng = np.random.default_rng(99)
    draws = x[rng.integers(len(x), size=KL_DRAWS)] + foot.bandwidth_m * rng.standard_normal((KL_DRAWS, 3))
    kde = Oracle(bandwidth=foot.bandwidth_m, leaf_size=len(x)).fit(x)
    ratio = kde.score_samples(draws) - foot.to_mixture().log_density(draws)
    error = np.hypot(foot.kl_sd_nats, ratio.std() / np.sqrt(KL_DRAWS))
    assert abs(ratio.mean() - foot.kl_nats) < 4 * error


def test_too_many_components_for_few_samples_show_in_what_is_held_out(fresh: ComCloud) -> None:
    card = fit(fresh.com_m["left_foot"][:250], "surface", "contact", seed=0)
    assert card.sizes[19].held_out_log_likelihood < card.sizes[2].held_out_log_likelihood
    assert card.components < 20


@pytest.mark.parametrize(
    ("kl", "excess_sd", "size"),
    [
        ((0.5, 0.10, 0.09, 0.12), (0.1, 0.02, 0.0, 0.04), 2),
        ((0.5, 0.12, 0.09, 0.12), (0.1, 0.02, 0.0, 0.04), 3),
        ((0.5, 0.12, 0.09, 0.05), (0.1, 0.02, 0.01, 0.0), 4),
        ((0.05, 0.05, 0.05, 0.05), (0.0, 0.01, 0.01, 0.01), 1),
    ],
)
def test_the_smallest_size_within_one_standard_error_of_the_best(
    kl: tuple[float, ...], excess_sd: tuple[float, ...], size: int
) -> None:
    curve = {i + 1: Divergence(value, 1.0, sd) for i, (value, sd) in enumerate(zip(kl, excess_sd, strict=True))}
    assert select_size(curve) == size


def test_a_robot_is_learned_from_its_postures(talos: Robot) -> None:
    fractions: list[float] = []
    names = ["right_hand", "left_foot"]
    learned = learn_densities(talos, DAY, names, 700, seed=5, progress=lambda f, _: fractions.append(f), processes=1)
    card = learned.card
    assert (card.robot, card.robot_sha256, card.seed) == ("talos", talos.sha256, 5)
    assert (card.samples, card.fitted, card.tried) == (700, 560, learned.cloud.tried)
    assert card.rejected_share == pytest.approx((card.tried - 700) / card.tried)
    assert card.learned_on == "2026-11-21"
    assert list(card.effectors) == names
    assert card.effectors["right_hand"].thesis_components == 14
    assert [pair.effectors for pair in card.pairs] == [("right_hand", "left_foot")]
    assert card.versions["scikit-learn"]
    assert fractions == sorted(fractions)
    assert 0.0 <= fractions[0] <= fractions[-1] <= 1.0
    again = learn_densities(talos, DAY, names, 700, seed=5, processes=2)
    assert again.card == card, "the seed decides, not how many processes there are"
    assert all((again.cloud.com_m[name] == learned.cloud.com_m[name]).all() for name in names)
    later = learn_densities(talos, date(2027, 1, 2), names, 700, seed=5, processes=1).card
    assert replace(later, learned_on=card.learned_on) == card
    other = learn_densities(talos, DAY, ["left_foot"], 700, seed=6, processes=1).card
    assert other.effectors["left_foot"].means != card.effectors["left_foot"].means


def test_the_default_is_all_effectors(talos: Robot) -> None:
    card = learn_densities(talos, DAY, samples=100, measure="conditioned").card
    assert list(card.effectors) == list(talos.effectors)
    assert card.measure == "conditioned"
    assert [effector.frame for effector in card.effectors.values()] == ["contact", "contact", "heading", "heading"]


def test_invalid_learning_requests_are_refused(talos: Robot) -> None:
    with pytest.raises(InvalidInput) as too_few:
        learn_densities(talos, DAY, ["left_foot"], 99)
    assert too_few.value.code == "too-few-samples"
    with pytest.raises(NotFound) as unknown:
        learn_densities(talos, DAY, ["left_foot", "tail"], 500)
    assert unknown.value.faults[0].where == "effectors[1]"


def fit_where_maps_are_forbidden(piece: int) -> bool:
    """Fit as a process that was forked inside the sandbox, which must not read ``/proc/self/maps``."""
    opened = builtins.open

    def refuse_maps(file: Any, *more: Any, **options: Any) -> Any:
        if str(file) == "/proc/self/maps":
            raise PermissionError(file)
        return opened(file, *more, **options)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(builtins, "open", refuse_maps)
        _, converged = expectation_maximisation(np.random.default_rng(piece).normal(size=(50, 3)), 2, 0)
    return converged


def test_processes_inside_the_sandbox_can_fit(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sklearn.utils.parallel._threadpool_controller", None)
    with pytest.raises(PermissionError):
        fit_where_maps_are_forbidden(0)
    prepare_fits()
    assert fit_where_maps_are_forbidden(0)
