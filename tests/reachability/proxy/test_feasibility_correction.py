"""Random contact sets with their truth, and the correction that is learned from them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from experiments.feasibility_learning import learn_feasibility, save_feasibility
from experiments.random_contacts import BOX_SCALE, LabelledPairs, balance_labels, random_pairs
from stridelab.dynamics.spatial import Placement
from stridelab.errors import NotFound, UnreadableFile
from stridelab.reachability.kinematics.ik_ground_truth import STANDING_POSTURE, StanceTruth
from stridelab.reachability.proxy.contact_set_proxy import ContactSet
from stridelab.reachability.proxy.feasibility_correction import (
    FeasibilityCard,
    load_feasibility,
    log_density,
    read_feasibility,
)
from stridelab.reachability.store import load_proxies
from stridelab.robots.robot import Robot


@pytest.fixture(scope="module")
def truth(talos: Robot) -> StanceTruth:
    return StanceTruth(talos, STANDING_POSTURE)


@pytest.fixture(scope="module")
def pairs(truth: StanceTruth) -> dict[bool, LabelledPairs]:
    return {
        hand: random_pairs(truth, stances=12, per_stance=25, seed=0, hand=hand, walkers=2, rounds=4)
        for hand in (False, True)
    }


def test_pairs_fill_the_grown_box(pairs: dict[bool, LabelledPairs]) -> None:
    for drawn in pairs.values():
        relative = (drawn.com_m - (drawn.low_m + drawn.high_m) / 2) / (drawn.high_m - drawn.low_m)
        assert np.abs(relative).max() <= BOX_SCALE / 2
        assert np.abs(relative).max() > 0.6
        assert 0.1 < drawn.feasible.mean() < 0.6
        assert (np.diff(drawn.shares) >= 0.0).all()


def test_the_requested_share_is_feasible(pairs: dict[bool, LabelledPairs]) -> None:
    drawn = pairs[False]
    balanced = balance_labels(drawn, 150, 0.4, np.random.default_rng(0))
    assert len(balanced.com_m) == 150
    assert balanced.feasible.sum() == 60
    assert {tuple(c) for c in balanced.com_m} <= {tuple(c) for c in drawn.com_m}


def test_the_correction_separates_and_survives_the_disk(
    talos: Robot, truth: StanceTruth, pairs: dict[bool, LabelledPairs], tmp_path: Path
) -> None:
    effectors = learn_feasibility(pairs[False], pairs[True], seed=0)
    assert set(effectors) == set(talos.effectors)
    card = FeasibilityCard("talos", talos.sha256, 0, 40, 800, effectors)
    path = tmp_path / "talos.json"
    save_feasibility(path, card)
    assert read_feasibility(path) == card
    proxies = {name: flat.to_proxy() for name, flat in card.effectors.items()}
    right, left = proxies["right_hand"].mixture, proxies["left_hand"].mixture
    np.testing.assert_array_equal(right.means_m * [1.0, -1.0, 1.0], left.means_m)
    unseen = random_pairs(truth, stances=8, per_stance=25, seed=9, hand=False, walkers=2, rounds=4)
    score = log_density(proxies, unseen.contacts, unseen.com_m)
    assert np.median(score[unseen.feasible]) > np.median(score[~unseen.feasible]) + 1.0


def test_missing_fields_of_a_file_are_named(talos: Robot, pairs: dict[bool, LabelledPairs], tmp_path: Path) -> None:
    card = FeasibilityCard("talos", talos.sha256, 0, 40, 800, learn_feasibility(pairs[False], pairs[True], seed=0))
    path = tmp_path / "spoilt.json"
    save_feasibility(path, replace(card, seed=0))
    path.write_text(path.read_text().replace('"frame": "heading"', '"frame": "sideways"'))
    with pytest.raises(UnreadableFile, match="frame"):
        read_feasibility(path)
    with pytest.raises(NotFound, match="nobody"):
        load_feasibility("nobody")


@pytest.mark.parametrize("name", ["talos", "hrp2"])
def test_the_bundled_correction_is_a_proxy(name: str) -> None:
    """The sum of logarithms over many sets is that of the product on one, up to its constant."""
    proxies = load_feasibility(name)
    assert len(proxies) == 4
    assert proxies["left_foot"].frame == "contact"
    assert proxies["left_hand"].frame == "heading"


def test_many_sets_at_once_agree_with_one(pairs: dict[bool, LabelledPairs]) -> None:
    """(4.13)."""
    drawn = pairs[True]
    proxies = load_proxies("talos", "conditioned")
    many = log_density(proxies, drawn.contacts, drawn.com_m)
    for k in (0, 57, 200):
        placements = {
            name: Placement(p[k], np.eye(3) if R is None else R[k]) for name, (p, R) in drawn.contacts.targets.items()
        }
        one = ContactSet.from_placements(proxies, placements, float(drawn.contacts.heading_rad[k]))
        assert one.log_density(drawn.com_m[k : k + 1])[0] + one.log_z == pytest.approx(many[k], abs=1e-9)
