"""Stances that the whole body can and cannot take, and the messages about them."""

import re
from collections.abc import Mapping

import numpy as np
import pinocchio as pin
import pytest

from stridelab.dynamics.spatial import Placement
from stridelab.errors import InvalidInput
from stridelab.robots.contact_frames import with_contact_frames
from stridelab.robots.inverse_kinematics import ComRegion, stand_in_com_region
from stridelab.robots.loader import load_robot
from stridelab.robots.robot import Robot
from stridelab.robots.self_collision import SelfCollision
from stridelab.wholebody.stance_check import Stance, StanceCheck, StanceResult, mid_swing_placement

APART_M = 0.21
ROBOTS = ("talos", "hrp2")


@pytest.fixture(scope="module", params=ROBOTS)
def check(request: pytest.FixtureRequest) -> StanceCheck:
    return StanceCheck(load_robot(request.param))


def feet(left: tuple[float, float], right: tuple[float, float] = (0.0, -APART_M / 2)) -> dict[str, Placement]:
    return {"left_foot": Placement.from_wxyz([*left, 0.0]), "right_foot": Placement.from_wxyz([*right, 0.0])}


def standing(check: StanceCheck, contacts: Mapping[str, Placement]) -> StanceResult:
    """With the CoM above the middle of the soles, 10 cm to either side."""
    com_m = check.usual_com_m(contacts)
    square = com_m[:2] + 0.1 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    return check.check_stance(Stance(contacts, com_m, square))


def held(robot: Robot, q: np.ndarray, contacts: Mapping[str, Placement]) -> float:
    """The largest distance of an effector from its contact, by the model itself."""
    model, frames = with_contact_frames(robot)
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    return max(float(np.abs(data.oMf[frames[name]].translation - p.position_m).max()) for name, p in contacts.items())


def test_a_usual_stance_is_reachable_and_its_posture_proves_it(check: StanceCheck) -> None:
    contacts = feet((0.15, APART_M / 2)) | {"right_hand": Placement.from_wxyz([0.3, -0.4, 0.75])}
    result = standing(check, contacts)
    assert (result.reachable, result.reason, result.limits, result.contact) == (True, "", (), None)
    robot = check.robot
    assert held(robot, result.q, contacts) < 1e-4
    assert np.all(result.q[7:] > robot.model.lowerPositionLimit[7:])
    assert np.all(result.q[7:] < robot.model.upperPositionLimit[7:])
    assert not SelfCollision(robot).any_collision(result.q)
    com_m = pin.centerOfMass(robot.model, robot.model.createData(), result.q)
    assert np.abs(com_m - check.usual_com_m(contacts))[:2].max() < 0.1 + 1e-4


def test_a_foot_a_metre_aside_is_out_of_reach(check: StanceCheck) -> None:
    result = standing(check, feet((0.0, 1.03 - APART_M / 2)))
    assert not result.reachable
    assert "foot" in result.reason
    assert not re.search("joint|_", result.reason, re.IGNORECASE), "limits are in words"
    assert result.contact in {"left_foot", "right_foot"}
    legs = [joint for joint in result.limits if check.robot.group.get(joint) == "leg"]
    assert legs, "a joint of the legs is what ran out"
    ends = np.minimum(
        result.q[7:] - check.robot.model.lowerPositionLimit[7:], check.robot.model.upperPositionLimit[7:] - result.q[7:]
    )
    for joint in legs:
        at = check.robot.joint_names.index(joint)
        width = check.robot.model.upperPositionLimit[7 + at] - check.robot.model.lowerPositionLimit[7 + at]
        assert ends[at] <= max(0.02, 0.02 * width + 0.005) + 2e-3


def test_a_hand_a_metre_and_a_half_away_is_out_of_reach(check: StanceCheck) -> None:
    result = standing(check, feet((0.0, APART_M / 2)) | {"right_hand": Placement.from_wxyz([1.5, -0.3, 1.0])})
    assert not result.reachable
    assert result.contact == "right_hand"
    assert "right hand" in result.reason


def test_feet_inside_each_other_collide(check: StanceCheck) -> None:
    result = standing(check, feet((0.0, -APART_M / 2 + 0.03)))
    assert not result.reachable
    assert "without touching itself" in result.reason
    assert len(result.limits) == 2
    assert result.contact is None


def test_legs_that_cross_at_first_are_pushed_apart() -> None:
    """A foot ahead of the other and across it: legs go through each other until they are pushed."""
    check = StanceCheck(load_robot("talos"))
    contacts = feet((0.25, -APART_M / 2 - 0.05))
    com_m = check.usual_com_m(contacts)
    plain = stand_in_com_region(check.robot, contacts, ComRegion.over_polygon(np.zeros((0, 2))), com_m)
    assert plain.converged
    assert SelfCollision(check.robot).any_collision(plain.q)
    result = check.check_stance(Stance(contacts, com_m))
    assert (result.reachable, result.strained) == (True, True)
    assert held(check.robot, result.q, contacts) < 1e-4


def test_the_com_stays_above_the_region(check: StanceCheck) -> None:
    """On one foot, with the CoM above its sole; above a place half a metre aside there is no posture."""
    contacts = {"left_foot": Placement.from_wxyz([0.0, 0.1, 0.0])}
    sole = np.array([[-0.05, 0.07], [0.05, 0.07], [0.05, 0.13], [-0.05, 0.13]])
    com_m = check.usual_com_m(contacts)
    result = check.check_stance(Stance(contacts, com_m, sole))
    assert result.reachable
    x, y, _ = pin.centerOfMass(check.robot.model, check.robot.model.createData(), result.q)
    assert -0.0501 < x < 0.0501
    assert 0.0699 < y < 0.1301
    away = check.check_stance(Stance(contacts, com_m, sole + np.array([0.0, 0.9])))
    assert not away.reachable


def test_a_verdict_is_a_function_of_the_stance(check: StanceCheck) -> None:
    """Whatever was checked before: a fresh check gives the same posture to the last digit."""
    contacts = feet((0.2, APART_M / 2))
    first = standing(check, contacts)
    standing(check, feet((0.0, 1.03 - APART_M / 2)))
    assert standing(check, contacts) is first
    fresh = standing(StanceCheck(check.robot), contacts)
    np.testing.assert_array_equal(fresh.q, first.q)


def test_a_paused_search_goes_on_to_the_same_posture() -> None:
    """Paused between all of its solves, and beside the search for another stance."""
    robot = load_robot("talos")
    check, fresh = StanceCheck(robot), StanceCheck(robot)
    contacts, others = feet((0.25, -APART_M / 2 - 0.05)), feet((0.0, -APART_M / 2 + 0.03))
    stance, other = (Stance(one, check.usual_com_m(one)) for one in (contacts, others))
    pauses, result = 0, check.continue_search(stance, lambda: True)
    while result is None:
        pauses += 1
        check.continue_search(other, lambda: True)
        result = check.continue_search(stance, lambda: True)
    assert pauses > 0
    assert check.has_result(stance)
    np.testing.assert_allclose(result.q, fresh.check_stance(stance).q, atol=1e-9)


def test_an_effector_that_is_not_there_is_refused(check: StanceCheck) -> None:
    with pytest.raises(InvalidInput) as refusal:
        standing(check, feet((0.0, 0.1)) | {"third_hand": Placement.from_wxyz([0.0, 0.0, 1.0])})
    assert refusal.value.code == "effector-unknown"


def test_a_swing_is_held_half_way_and_lifted() -> None:
    a, b = Placement.from_wxyz([0.0, 0.1, 0.0]), Placement.from_wxyz([0.4, 0.1, 0.15])
    half = mid_swing_placement(a, b)
    assert half is not None
    np.testing.assert_allclose(half.position_m, [0.2, 0.1, 0.21])
    assert mid_swing_placement(None, None) is None
    only = mid_swing_placement(None, b)
    assert only is not None
    np.testing.assert_allclose(only.position_m, [0.4, 0.1, 0.21])
