"""Bundled densities are about the robots that are loaded; those of TALOS hold for postures that they never saw."""

import numpy as np
import pytest
from scipy.stats import binom

from stridelab.machine.models_folder import models_dir
from stridelab.reachability.card import ReachabilityCard
from stridelab.reachability.gaussian_mixture import Mixture
from stridelab.reachability.learning.com_sampling import BLOCK, ComCloud, frame_of, sample_com
from stridelab.reachability.learning.fit import kl_divergences
from stridelab.reachability.store import load_card, load_cloud, load_proxies, require_same_robot
from stridelab.robots.card import robot_names
from stridelab.robots.loader import load_robot
from stridelab.robots.robot import Robot

EFFECTORS = ("left_foot", "right_foot", "left_hand", "right_hand")
BUNDLED = sorted((path.parent.name, path.stem) for path in (models_dir() / "reachability").glob("*/*.json"))


@pytest.fixture(scope="module")
def card() -> ReachabilityCard:
    return load_card("talos", "uniform")


@pytest.mark.parametrize(("robot", "measure"), BUNDLED)
def test_a_card_is_about_the_robot_that_is_loaded(robot: str, measure: str) -> None:
    loaded, learned = load_robot(robot), load_card(robot, measure)
    require_same_robot(learned, loaded)
    assert tuple(learned.effectors) == tuple(loaded.effectors) == EFFECTORS
    assert (learned.samples, learned.seed) == (20_000, 0)
    assert learned.rejected_share == pytest.approx(1 - 20_000 / learned.tried)
    assert {name: points.shape for name, points in load_cloud(robot, measure).items()} == dict.fromkeys(
        EFFECTORS, (5000, 3)
    )
    for name, effector in learned.effectors.items():
        assert effector.frame == frame_of(loaded.effectors[name], learned.measure)
        assert effector.thesis_components == (7 if "foot" in name else 14)


@pytest.mark.parametrize(("robot", "measure"), BUNDLED)
def test_the_chosen_size_is_within_one_standard_error_of_the_best(robot: str, measure: str) -> None:
    """Of 1 to 20, by the standard error of the difference and by that of the estimate; no smaller size is."""
    for effector in load_card(robot, measure).effectors.values():
        assert [trial.components for trial in effector.sizes] == list(range(1, 21))
        best = min(effector.sizes, key=lambda trial: trial.kl_nats)
        near = [trial for trial in effector.sizes if trial.kl_nats - best.kl_nats <= trial.excess_sd_nats]
        assert effector.components == near[0].components
        assert effector.kl_nats - best.kl_nats <= best.kl_sd_nats


def test_every_robot_has_densities() -> None:
    assert {(name, "uniform") for name in robot_names()} <= set(BUNDLED)


def test_it_was_learned_as_the_thesis_says(card: ReachabilityCard) -> None:
    assert card.measure == "uniform"
    assert all(effector.frame == "contact" and effector.em_converged for effector in card.effectors.values())
    assert len(card.pairs) == 6


@pytest.mark.parametrize("name", EFFECTORS)
def test_the_sizes_of_the_thesis_lose_little(card: ReachabilityCard, name: str) -> None:
    """Figure 4.3 is flat there: less than three standard errors of the estimate above the best."""
    effector = card.effectors[name]
    assert effector.sizes[0].kl_nats > 4 * effector.kl_nats
    best = min(effector.sizes, key=lambda trial: trial.kl_nats)
    assert effector.sizes[effector.thesis_components - 1].kl_nats < best.kl_nats + 3 * best.kl_sd_nats


def test_the_cloud_is_that_of_the_seed(card: ReachabilityCard, talos: Robot) -> None:
    """The first block, drawn again, equals the stored one to half a millimetre."""
    cloud = load_cloud("talos", "uniform")
    again = sample_com(talos, EFFECTORS, BLOCK, card.seed)
    for name in EFFECTORS:
        assert cloud[name].shape == (5000, 3)
        np.testing.assert_allclose(cloud[name][:BLOCK], again.com_m[name], atol=0.5e-3 + 1e-9)


@pytest.mark.parametrize("name", EFFECTORS)
def test_the_held_out_likelihood_is_that_of_new_postures(card: ReachabilityCard, fresh: ComCloud, name: str) -> None:
    effector = card.effectors[name]
    log_p = effector.to_mixture().log_density(fresh.com_m[name])
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
    mixture, mode = effector.to_mixture(), np.array(effector.mode_m)
    assert np.abs(mixture.gradient(mode[None])).max() < 1e-6
    around = mode + 0.02 * np.random.default_rng(0).standard_normal((500, 3))
    assert mixture.log_density(around).max() < effector.mode_log_density
    assert mixture.log_density(mode[None])[0] == pytest.approx(effector.mode_log_density)


@pytest.mark.parametrize(("part", "bound_nats"), [("foot", 0.02), ("hand", 0.05)])
def test_left_and_right_mirror_each_other(part: str, bound_nats: float) -> None:
    """As far apart as two fits of one law: each is a few hundredths of a nat off its own samples."""
    proxies = load_proxies("talos", "uniform")
    left, right = proxies[f"left_{part}"].mixture, proxies[f"right_{part}"].mixture
    flip = np.diag([1.0, -1.0, 1.0])
    mirrored = Mixture(right.weights, right.means_m @ flip, flip @ right.covariances_m2 @ flip)
    same, crossed = kl_divergences(left, [mirrored, right], 4000, np.random.default_rng(0))
    assert same.kl_nats < bound_nats
    if part == "foot":
        assert crossed.kl_nats > 5 * bound_nats


def test_the_densest_place_over_a_sole_is_not_where_a_robot_stands(card: ReachabilityCard) -> None:
    """The thesis' measure prefers folded postures; ``conditioned`` does not."""
    for name, side in (("left_foot", -1.0), ("right_foot", 1.0)):
        x, y, z = card.effectors[name].mode_m
        assert x < -0.5
        assert y == pytest.approx(side * 0.08, abs=0.03)
        assert z < 0.45, "a standing robot's is at 0.88"


def test_given_that_the_robot_stands_the_com_is_high(talos: Robot) -> None:
    """Uniform: half of it below 0.64 m."""
    cloud = sample_com(talos, ["left_foot"], 300, 0, "conditioned")
    low, median, high = np.percentile(cloud.com_m["left_foot"][:, 2], [5, 50, 95])
    assert low > 0.5
    assert 0.7 < median < 0.9
    assert high < 1.0
