"""Ground truth on fixed contacts: postures hold them, and the search reaches known feasible positions."""

import numpy as np
import pinocchio as pin
import pytest

from stridelab.dynamics.spatial import Placement
from stridelab.errors import NotEstimable
from stridelab.reachability.kinematics.ik_ground_truth import ANY_POSTURE, STANDING_POSTURE, ContactBatch, StanceTruth
from stridelab.robots.contact_frames import with_contact_frames
from stridelab.robots.robot import Robot
from stridelab.robots.self_collision import SelfCollision

FLAT = {"left_foot": Placement.from_wxyz((0.0, 0.09, 0.0)), "right_foot": Placement.from_wxyz((0.0, -0.09, 0.0))}
STAIR = {"left_foot": FLAT["left_foot"], "right_foot": Placement.from_wxyz((0.30, -0.09, 0.15))}
RAIL = STAIR | {"right_hand": Placement.from_wxyz((0.37, -0.50, 0.95))}


@pytest.fixture(scope="module")
def anyhow(talos: Robot) -> StanceTruth:
    return StanceTruth(talos, ANY_POSTURE)


@pytest.fixture(scope="module")
def standing(talos: Robot) -> StanceTruth:
    return StanceTruth(talos, STANDING_POSTURE)


@pytest.mark.parametrize("contacts", [FLAT, RAIL], ids=["two soles", "two soles and a hand"])
def test_postures_hold_the_contacts_within_the_limits(
    talos: Robot, standing: StanceTruth, contacts: dict[str, Placement]
) -> None:
    model, frames = with_contact_frames(talos)
    data = model.createData()
    for q in standing.sample_postures(contacts, 40, seed=0):
        pin.framesForwardKinematics(model, data, q)
        for name, at in contacts.items():
            np.testing.assert_allclose(data.oMf[frames[name]].translation, at.position_m, atol=2e-6)
            if talos.effectors[name].kind == "surface":
                np.testing.assert_allclose(data.oMf[frames[name]].rotation, at.rotation, atol=2e-6)
        assert (q[7:] >= model.lowerPositionLimit[7:]).all()
        assert (q[7:] <= model.upperPositionLimit[7:]).all()
        assert not SelfCollision(talos).any_collision(q)
        up = data.oMi[1].rotation[:, 2]
        assert np.degrees(np.arccos(up[2])) < 29.0, "roll and pitch of 20 degrees each at most"


def test_the_com_over_two_soles_side_by_side(anyhow: StanceTruth) -> None:
    """Height that 5, 50 and 95 % are below, as an independent program with the same ranges measured it."""
    c = anyhow.sample_com(FLAT, 600, seed=1)
    np.testing.assert_allclose(np.percentile(c[:, 2], (5, 50, 95)), (0.61, 0.76, 0.91), atol=0.04)
    assert abs(c[:, 1].mean()) < 0.02


def test_the_same_seed_gives_the_same_draws(standing: StanceTruth) -> None:
    assert (standing.sample_com(STAIR, 10, seed=3) == standing.sample_com(STAIR, 10, seed=3)).all()
    assert (standing.sample_com(STAIR, 10, seed=3) != standing.sample_com(STAIR, 10, seed=4)).any()


@pytest.mark.parametrize("contacts", [STAIR, RAIL], ids=["stair", "rail"])
def test_com_positions_reached_by_postures_are_feasible(
    talos: Robot, standing: StanceTruth, contacts: dict[str, Placement]
) -> None:
    """The CoM of drawn postures: feasible by construction. High above and far aside: not."""
    c = standing.sample_com(contacts, 60, seed=5)
    many = ContactBatch.from_placements(talos, [contacts]).select(np.zeros(60, dtype=int))
    feasible, shares = standing.search_feasible(many, c, rounds=12, seed=0)
    assert feasible.mean() >= 0.95
    assert (np.diff(shares) >= 0.0).all()
    assert shares[-1] == feasible.mean()
    for away in ((0.0, 0.0, 0.6), (0.0, 1.0, 0.0)):
        assert not standing.search_feasible(many, c + np.array(away), rounds=2, seed=0)[0].any()


def test_the_support_reaches_beyond_all_draws(talos: Robot, standing: StanceTruth) -> None:
    c = standing.sample_com(STAIR, 300, seed=6)
    low, high, there = standing.com_bounds(ContactBatch.from_placements(talos, [STAIR]), walkers=8, seed=0)
    assert there.all()
    assert (low[0] <= c.min(axis=0) + 0.01).all()
    assert (high[0] >= c.max(axis=0) - 0.01).all()
    assert (high[0] - low[0] < 1.4).all()


def test_contacts_out_of_reach_have_no_posture(
    talos: Robot, standing: StanceTruth, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("stridelab.reachability.kinematics.ik_ground_truth.MAX_BATCHES", 2)
    apart = {"left_foot": FLAT["left_foot"], "right_foot": Placement.from_wxyz((0.0, -3.0, 0.0))}
    with pytest.raises(NotEstimable, match="0 of 5"):
        standing.sample_com(apart, 5, seed=0)
    assert not standing.com_bounds(ContactBatch.from_placements(talos, [apart]), walkers=2, seed=0)[2].any()
