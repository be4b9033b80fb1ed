"""The proxy against the truth: areas and volumes where they are known, and a small run of the whole."""

from dataclasses import replace
from unittest.mock import Mock

import numpy as np
import pytest
from scipy.stats import chi2, mannwhitneyu

from experiments.proxy_roc import box_depth_m, regression_features, roc_area, roc_area_sd, roc_areas
from experiments.random_contacts import LabelledPairs, random_pairs
from stridelab.dynamics.spatial import Placement
from stridelab.reachability.gaussian_mixture import Mixture
from stridelab.reachability.kinematics.ik_ground_truth import (
    ANY_POSTURE,
    FREE_TRUNK,
    STANDING_POSTURE,
    ContactBatch,
    StanceTruth,
)
from stridelab.reachability.kinematics.whole_body_ik import Target
from stridelab.reachability.learning.kde import KernelDensity, held_out_bandwidth_m
from stridelab.reachability.proxy.effector_proxy import Proxy
from stridelab.reachability.proxy.feasibility_correction import load_feasibility
from stridelab.reachability.standing_conditions import axis_rotations
from stridelab.reachability.store import load_card, load_proxies
from stridelab.reproduction.chapter4.fig_4_5 import comparison_table, figure_claims, stack_svgs
from stridelab.reproduction.studies import proxy_accuracy
from stridelab.reproduction.studies.proxy_accuracy import (
    BANDWIDTH_M,
    Truth,
    compare_densities,
    four_stances,
    share_denser,
    stair_contacts,
)
from stridelab.robots.loader import load_robot


@pytest.fixture(scope="module")
def pairs() -> LabelledPairs:
    truth = StanceTruth(load_robot("talos"), STANDING_POSTURE)
    return random_pairs(truth, stances=16, per_stance=24, seed=3, hand=False, walkers=2, rounds=6)


@pytest.mark.parametrize(("robot", "aside_m"), [("talos", 0.09), ("hrp2", 0.105)])
def test_four_stances_have_the_second_sole_where_their_names_say(robot: str, aside_m: float) -> None:
    """Stairs are 30 cm deep, and half a stride is 45 cm."""
    seconds = {"flat": (0.0, 0.0), "stair of 0.10 m": (0.30, 0.10), "stair of 0.15 m": (0.30, 0.15),
               "half stride": (0.45, 0.0)}  # fmt: skip
    stances = four_stances(robot)
    assert all(stance["left_foot"].position_m.tolist() == [0.0, aside_m, 0.0] for stance in stances.values())
    assert {name: stance["right_foot"].position_m.tolist() for name, stance in stances.items()} == {
        name: [ahead_m, -aside_m, up_m] for name, (ahead_m, up_m) in seconds.items()
    }


def test_the_area_is_the_chance_to_rank_a_pair_rightly() -> None:
    rng = np.random.default_rng(0)
    positive = rng.random(300) < 0.4
    score = rng.normal(size=300).round(1) + 0.8 * positive
    expected = mannwhitneyu(score[positive], score[~positive]).statistic / (positive.sum() * (~positive).sum())
    assert roc_area(positive, score) == pytest.approx(expected, abs=1e-12)
    assert roc_area(positive, positive.astype(float)) == 1.0
    assert roc_area(positive, np.zeros(300)) == 0.5


def test_the_proxy_separates_feasible_from_infeasible(pairs: LabelledPairs) -> None:
    """A small run of the table in the documentation, and no stand-in for it: on so few contact sets an area is known
    to 0.015, and after a short search some of the feasible pairs still pass for infeasible.
    """
    result = {row.score: row for row in roc_areas("talos", pairs, load_feasibility("talos"))}
    assert result["product, corrected"].area > 0.9
    assert result["product, conditioned"].area > 0.87
    assert result["product, corrected"].area > result["boxes, conditioned"].area
    assert 0.0 < result["product, corrected"].area_sd < 0.03


def test_depth_in_a_box(pairs: LabelledPairs) -> None:
    card = load_card("talos", "conditioned")
    deep = box_depth_m(card, pairs)
    seen = pairs.com_m - pairs.contacts.targets["left_foot"].p_m
    low, high = (
        np.array(end)
        for end in (card.effectors["left_foot"].reach.com_low_m, card.effectors["left_foot"].reach.com_high_m)
    )
    outside = ((seen < low) | (seen > high)).any(axis=1)
    assert (deep[outside] < 0.0).all()
    assert (deep <= np.minimum(seen - low, high - seen).min(axis=1) + 1e-12).all()
    assert roc_area_sd(pairs, deep) > 0.0


def test_features_do_not_change_where_the_world_is_turned(pairs: LabelledPairs) -> None:
    turn = np.pi / 3
    R = axis_rotations(2, np.full(1, turn))[0]
    targets = {n: Target(p @ R.T, None if M is None else R @ M) for n, (p, M) in pairs.contacts.targets.items()}
    turned = replace(pairs, contacts=ContactBatch(targets, pairs.contacts.heading_rad + turn), com_m=pairs.com_m @ R.T)
    seen, again = regression_features(pairs), regression_features(turned)
    assert seen.shape == (len(pairs.com_m), 7)
    np.testing.assert_allclose(again[:, :6], seen[:, :6], atol=1e-12)


def test_a_product_equal_to_its_truth() -> None:
    """Kernels around one point against the same Gaussian: equal sets, the mode at the top, and a shifted one."""
    centre = np.array([0.15, 0.0, 0.80])
    search = StanceTruth(load_robot("talos"), ANY_POSTURE)
    kernels = KernelDensity(centre[None], BANDWIDTH_M)
    unseen = kernels.sample(3000, np.random.default_rng(0))
    truth = Truth(kernels, unseen, kernels.log_density(unseen))
    stair = stair_contacts("talos")["2 contacts"]

    def gaussian(at: np.ndarray) -> dict[str, Proxy]:
        """Two factors of twice the variance, that multiply to the kernel."""
        spread = 2 * BANDWIDTH_M**2 * np.eye(3)[None]
        return {n: Proxy(Mixture(np.ones(1), (at - p.position_m)[None], spread)) for n, p in stair.items()}

    same, other = compare_densities(
        search,
        "stair",
        stair,
        truth,
        {"same": gaussian(centre), "other": gaussian(centre + np.array([1.0, 0.0, 0.0]))},
        probes=40,
    )
    assert same.mass_inside == pytest.approx(0.95, abs=0.02)
    assert same.truth_inside == pytest.approx(0.95, abs=0.02)
    assert same.density_at_mode == pytest.approx(1.0, abs=1e-3)
    np.testing.assert_allclose(same.product_volumes_m3, same.truth_volumes_m3, rtol=0.1)
    assert same.false_feasible < 0.1
    assert other.mass_inside < 0.01
    assert other.density_at_mode < 1e-6
    assert other.false_feasible == 1.0


def test_conditioned_densities_lie_in_the_truth_where_uniform_ones_do_not() -> None:
    search = StanceTruth(load_robot("talos"), ANY_POSTURE)
    densities = {name: load_proxies("talos", name) for name in ("uniform", "conditioned")}
    placements: dict[str, Placement] = four_stances("talos")["flat"]
    truth = Truth.of(search, placements, 400)
    uniform, conditioned = compare_densities(search, "flat", placements, truth, densities, probes=40)
    assert conditioned.mass_inside > 0.9
    assert uniform.mass_inside < 0.6
    assert uniform.density_at_mode < 0.2 < conditioned.density_at_mode
    assert len(comparison_table([uniform, conditioned])["contacts"]) == 2


def test_the_uniform_product_covers_the_truth_with_a_trunk_as_free_as_its_own() -> None:
    """On two feet of HRP-2; a truth that forbids what the densities contain would call the thesis wrong."""
    search = StanceTruth(load_robot("hrp2"), FREE_TRUNK)
    placements = stair_contacts("hrp2")["2 contacts"]
    com_m = search.sample_com(placements, 300, 0)
    truth = Truth.from_postures(com_m, held_out_bandwidth_m([com_m[:150]]))
    (row,) = compare_densities(search, "stair", placements, truth, {"uniform": load_proxies("hrp2", "uniform")}, 10)
    assert row.denser_interval[0] < row.denser_than_mode < row.denser_interval[1]
    assert row.product_volumes_m3[-1] > row.truth_volumes_m3[-1]
    assert row.mass_inside > 0.7
    claims = {claim.key: claim for claim in figure_claims([row, row, replace(row, densities="conditioned")])}
    assert claims["volume_over_truth"].verdict == "met"
    for share, spread, verdict in ((0.2, 0.1, "met"), (0.9, 0.1, "not_met"), (0.52, 0.1, "undecided")):
        near, far = (
            replace(row, denser_than_mode=at, denser_interval=(at - spread, at + spread)) for at in (0.1, share)
        )
        claims = {claim.key: claim for claim in figure_claims([near, far, replace(row, densities="conditioned")])}
        assert claims["denser_than_mode"].verdict == verdict
        assert claims["denser_than_mode"].interval == pytest.approx((share - spread, share + spread)), "the worst set"


def test_half_of_a_normal_distribution_is_denser_than_its_median_radius() -> None:
    """Kernels of 3 cm blur normal postures of 10 cm; 95 % of the intervals contain the share, of three at once all."""
    rng, covered, wider = np.random.default_rng(5), 0, 0
    for radius_m in np.repeat([0.03, 0.1 * np.sqrt(chi2.ppf(0.5, 3)), 0.2], 20):
        com_m = 0.1 * rng.standard_normal((300, 3))
        truth, at = Truth.from_postures(com_m, 0.03), np.array([0.0, radius_m, 0.0])
        share, (low, high) = share_denser(truth, at)
        assert low <= share <= high
        covered += low <= chi2.cdf((radius_m / 0.1) ** 2, 3) <= high
        three = share_denser(truth, at, 3)[1]
        wider += three[1] - three[0] > high - low
    assert covered >= 57
    assert wider == 60


def test_the_set_of_the_truth_is_that_which_holds_its_share_of_unseen_postures() -> None:
    """Kernels of 0.1 m blur normal samples of 0.1 m: the set is the ball that holds 95 % of the samples themselves."""
    rng = np.random.default_rng(0)
    truth = Truth.from_postures(0.1 * rng.standard_normal((6000, 3)), 0.1)
    radius_m = 0.1 * np.sqrt(chi2.ppf(0.95, 3))
    assert truth.volume_m3(0.95) == pytest.approx(4 / 3 * np.pi * radius_m**3, rel=0.1)


def test_the_bandwidth_is_that_under_which_the_others_are_likely() -> None:
    """Few samples of a normal distribution: near the width that minimises the expected divergence, and none far off."""
    rng = np.random.default_rng(1)
    few, many = (held_out_bandwidth_m([0.1 * rng.standard_normal((n, 3))]) for n in (30, 2000))
    assert many < few
    assert 0.02 <= many <= 0.05
    assert held_out_bandwidth_m([np.zeros((2, 3)), np.ones((2, 3))], (0.01, 0.02)) == 0.01


def test_blocks_lie_below_each_other() -> None:
    block = '<svg viewBox="0 0 720 100" width="720" height="100"></svg>\n'
    assert 'viewBox="0 0 720 200"' in stack_svgs([block, block])
    assert "translate(0 100)" in stack_svgs([block, block])


def test_positions_without_a_posture_are_searched_evenly_in_the_set() -> None:
    """Ten rounds each; where the set is twice as dense, its samples count half, and those outside not at all."""
    asked: list[tuple[int, int, int]] = []

    def search_feasible(contacts: ContactBatch, com_m: np.ndarray, rounds: int, seed: int) -> tuple[np.ndarray, object]:
        asked.append((len(contacts.heading_rad), rounds, seed))
        assert com_m[:, 0].max() < 3.0, "outside of the set"
        return com_m[:, 0] < 1.0, None

    draws = np.column_stack([np.repeat([0.5, 2.0, 3.5], [2000, 1000, 500]), np.zeros((3500, 2))])
    log_q = np.repeat([np.log(2.0), 0.0, -0.1], [2000, 1000, 500])
    contacts = ContactBatch({"left_foot": Target(np.zeros((1, 3)), np.eye(3)[None])}, np.zeros(1))
    search = Mock(spec=StanceTruth, search_feasible=search_feasible)
    share = proxy_accuracy._false_feasible(search, contacts, draws, log_q, 0.0, 4000)
    assert share == pytest.approx(0.5, abs=0.03)
    assert asked == [(4000, 10, 2)]
