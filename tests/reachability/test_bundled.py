"""The bundled densities of TALOS hold for postures that they were not learned from."""

import numpy as np
import pytest
from scipy.stats import binom

from stridelab.reachability.card import ReachabilityCard
from stridelab.reachability.divergence import divergences
from stridelab.reachability.mixture import Mixture
from stridelab.reachability.sampling import ComCloud, sample_com
from stridelab.reachability.store import load_card, load_proxies
from stridelab.robots.robot import Robot

EFFECTORS = ("left_foot", "right_foot", "left_hand", "right_hand")


@pytest.fixture(scope="module")
def card() -> ReachabilityCard:
    return load_card("talos")


def test_it_is_about_the_robot_that_is_loaded(card: ReachabilityCard, talos: Robot) -> None:
    assert card.robot_sha256 == talos.sha256
    assert tuple(card.effectors) == tuple(talos.effectors) == EFFECTORS


def test_it_was_learned_as_the_thesis_says(card: ReachabilityCard) -> None:
    assert (card.samples, card.measure) == (20_000, "uniform")
    assert {name: effector.components for name, effector in card.effectors.items()} == {
        "left_foot": 7,
        "right_foot": 7,
        "left_hand": 14,
        "right_hand": 14,
    }
    assert all(effector.em_converged for effector in card.effectors.values())
    assert len(card.pairs) == 6


@pytest.mark.parametrize("name", EFFECTORS)
def test_the_chosen_size_is_where_the_curve_is_flat(card: ReachabilityCard, name: str) -> None:
    """Figure 4.3: from there on more components gain nothing that the estimate could tell."""
    effector = card.effectors[name]
    best = min(effector.sizes, key=lambda trial: trial.kl_nats)
    assert effector.kl_nats - best.kl_nats < 2 * np.hypot(effector.kl_sd_nats, best.kl_sd_nats)
    assert effector.sizes[0].kl_nats > 4 * effector.kl_nats


@pytest.mark.parametrize("name", EFFECTORS)
def test_the_held_out_likelihood_is_that_of_new_postures(card: ReachabilityCard, fresh: ComCloud, name: str) -> None:
    effector = card.effectors[name]
    log_p = effector.mixture().log_density(fresh.com_m[name])
    error = np.hypot(effector.held_out_log_likelihood_sd, log_p.std() / np.sqrt(len(log_p)))
    assert abs(log_p.mean() - effector.held_out_log_likelihood) < 4 * error


@pytest.mark.parametrize("name", EFFECTORS)
def test_the_box_holds_99_percent_of_new_postures_along_every_axis(
    card: ReachabilityCard, fresh: ComCloud, name: str
) -> None:
    reach, x = card.effectors[name].reach, fresh.com_m[name]
    least, most = binom.ppf([1e-4, 1 - 1e-4], len(x), 0.005)
    for outside in ((x < reach.com_low_m).sum(axis=0), (x > reach.com_high_m).sum(axis=0)):
        assert (outside >= least - 1).all()
        assert (outside <= most + 4).all()
    farthest = np.linalg.norm(x, axis=1).max()
    assert 0.9 * reach.com_distance_max_m < farthest < 1.05 * reach.com_distance_max_m


def test_new_postures_spread_the_effectors_hardly_farther(card: ReachabilityCard, fresh: ComCloud) -> None:
    """The largest distance of samples is no limit: each pair of 2000 new ones goes beyond it one time in eleven."""
    for pair in card.pairs:
        assert 0.9 < fresh.pair_distance_max_m[pair.effectors] / pair.distance_max_m < 1.05


def test_the_share_of_free_postures_is_the_same(card: ReachabilityCard, fresh: ComCloud) -> None:
    share = card.samples / card.tried
    assert abs(2000 / fresh.tried - share) < 4 * np.sqrt(share * (1 - share) / fresh.tried)


@pytest.mark.parametrize("name", EFFECTORS)
def test_the_modes_are_maxima(card: ReachabilityCard, name: str) -> None:
    effector = card.effectors[name]
    mixture, mode = effector.mixture(), np.array(effector.mode_m)
    assert np.abs(mixture.gradient(mode[None])).max() < 1e-6
    around = mode + 0.02 * np.random.default_rng(0).standard_normal((500, 3))
    assert mixture.log_density(around).max() < effector.mode_log_density
    assert mixture.log_density(mode[None])[0] == pytest.approx(effector.mode_log_density)


@pytest.mark.parametrize(("part", "bound_nats"), [("foot", 0.02), ("hand", 0.05)])
def test_left_and_right_mirror_each_other(part: str, bound_nats: float) -> None:
    """As far apart as two fits of one law: each is a few hundredths of a nat off its own samples."""
    proxies = load_proxies("talos")
    right = proxies[f"right_{part}"]
    flip = np.diag([1.0, -1.0, 1.0])
    mirrored = Mixture(right.weights, right.means_m @ flip, flip @ right.covariances_m2 @ flip)
    same, crossed = divergences(proxies[f"left_{part}"], [mirrored, right], 4000, np.random.default_rng(0))
    assert same.kl_nats < bound_nats
    if part == "foot":
        assert crossed.kl_nats > 5 * bound_nats


def test_the_densest_place_over_a_sole_is_not_where_a_robot_stands(card: ReachabilityCard) -> None:
    """The thesis' measure prefers folded postures; ``conditioned`` does not."""
    for name, side in (("left_foot", -1.0), ("right_foot", 1.0)):
        mode = np.array(card.effectors[name].mode_m)
        np.testing.assert_allclose(mode, [-0.55, side * 0.08, 0.13], atol=0.03)


def test_given_that_the_robot_stands_the_com_is_high(talos: Robot) -> None:
    cloud = sample_com(talos, ["left_foot"], 300, np.random.default_rng(0), "conditioned")
    low, median, high = np.percentile(cloud.com_m["left_foot"][:, 2], [5, 50, 95])
    assert (low, median, high) == pytest.approx((0.56, 0.77, 0.94), abs=0.05)
