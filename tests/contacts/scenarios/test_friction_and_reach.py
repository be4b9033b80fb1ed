"""Slopes that do not hold, and contacts that are too far from each other."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation as ScipyRotation

from stridelab.contacts.effector_geometry import EffectorShape
from stridelab.contacts.scenarios.stairs import HandRail, Stairs, flat_walk, six_stairs, stairs_with_rail
from stridelab.contacts.validation.validate import validate_scenario
from support.robots.scenario_bodies import FOOT_REACH, SHAPES, Made, faults, judged


def ramp(degrees: float, friction: float) -> Made:
    """Standing on a ramp that falls along x."""
    turn = ScipyRotation.from_euler("y", degrees, degrees=True)
    x, y, z, w = turn.as_quat()
    scenario = flat_walk()
    wxyz = [float(value) for value in (w, x, y, z)]
    scenario["terrain"] = [
        {
            "name": "ramp",
            "kind": "box",
            "center_m": [0.0, 0.0, 0.0],
            "size_m": [3.0, 2.0, 0.2],
            "orientation_wxyz": wxyz,
        }
    ]
    scenario["phases"] = scenario["phases"][:1]
    scenario["friction"] = friction
    for entry in scenario["phases"][0]["contacts"]:
        side = 0.09 if entry["effector"] == "left_foot" else -0.09
        entry.update(position_m=turn.apply([0.0, side, 0.1]).tolist(), orientation_wxyz=wxyz)
    return scenario


@pytest.mark.parametrize(("degrees", "friction", "valid"), [(16.0, 0.3, True), (17.0, 0.3, False), (30.0, 0.6, True)])
def test_slopes_hold_as_far_as_friction_goes(degrees: float, friction: float, valid: bool) -> None:
    report = validate_scenario(ramp(degrees, friction), SHAPES)
    assert report.valid is valid
    if not valid:
        assert faults(report) == [
            (
                "phases[0].contacts[left_foot]",
                "slips: 'ramp' is 17 degrees steep, and friction 0.3 holds up to 16.7 degrees",
            )
        ]


def test_two_slopes_that_face_each_other_hold_more_than_one() -> None:
    scenario = flat_walk()
    scenario["terrain"], scenario["phases"] = [], scenario["phases"][:1]
    for entry, side, angle in zip(scenario["phases"][0]["contacts"], (1.0, -1.0), (25.0, -25.0), strict=True):
        turn = ScipyRotation.from_euler("x", angle, degrees=True)
        x, y, z, w = turn.as_quat()
        wxyz = [float(value) for value in (w, x, y, z)]
        center = np.array([0.0, side * 0.3, 0.0])
        scenario["terrain"].append(
            {"name": f"bank {entry['effector']}", "kind": "box", "center_m": center.tolist(), "size_m": [1.0, 0.4, 0.2],
                 "orientation_wxyz": wxyz}
        )  # fmt: skip
        entry.update(position_m=(center + turn.apply([0.0, 0.0, 0.1])).tolist(), orientation_wxyz=wxyz)
    assert validate_scenario(scenario, SHAPES).valid
    one_leg = scenario | {"phases": [scenario["phases"][0] | {"contacts": scenario["phases"][0]["contacts"][:1]}]}
    assert "slips" in validate_scenario(one_leg, SHAPES).faults[0].message


def test_a_stair_of_one_and_a_half_metres() -> None:
    report = validate_scenario(six_stairs(Stairs(1, 1.5)), SHAPES)
    lacking = 1.5 + FOOT_REACH.com_low_m[2] - FOOT_REACH.com_high_m[2]
    ((where, message),) = faults(report)
    assert where == "phases[2].contacts[right_foot]"
    assert message == f"{lacking:.2f} m too far from left_foot for this robot: lower it by {lacking:.1g} m"
    assert min(margin.reach_m or 0.0 for margin in report.margins) == pytest.approx(-lacking / 2, abs=1e-3)


@pytest.mark.parametrize(("height", "valid"), [(1.05, True), (1.15, False)])
def test_the_limits_decide_how_high_a_stair_may_be(height: float, valid: bool) -> None:
    assert validate_scenario(six_stairs(Stairs(1, height)), SHAPES).valid is valid


def test_a_hand_too_far_away() -> None:
    report = validate_scenario(stairs_with_rail(rail=HandRail(y_m=-2.2)), SHAPES)
    where, message = faults(report)[0]
    assert where == "phases[0].contacts[right_hand]"
    assert "too far from" in message


def test_what_is_missing_is_enough() -> None:
    """Moved by what the message says, the contact is within reach, and by nine tenths of it, it is not."""
    report = validate_scenario(six_stairs(Stairs(1, 1.5)), SHAPES)
    lacking = float(report.faults[0].message.split(" m ")[0])
    assert validate_scenario(six_stairs(Stairs(1, 1.5 - lacking)), SHAPES).valid
    assert not validate_scenario(six_stairs(Stairs(1, 1.5 - 0.9 * lacking)), SHAPES).valid


def test_the_moment_between_two_phases_counts() -> None:
    """A hand lets go behind as a foot lands ahead: neither phase has both contacts, the instant between them does."""

    def change(s: Made) -> None:
        s["terrain"].append(
            {"name": "bar", "kind": "rail", "from_m": [-1.2, -1.0, 0.98], "to_m": [-1.2, 2.0, 0.98], "radius_m": 0.02}
        )
        hold = {"effector": "left_hand", "position_m": [-1.2, 0.3, 1.0]}
        for phase in s["phases"][:2]:
            phase["contacts"].append(hold)

    ((where, message),) = faults(judged(flat_walk(steps=2, step_m=0.7), change))
    assert where == "phases[2].contacts[right_foot]"
    assert "too far from left_hand" in message


def test_a_robot_without_limits_is_not_judged_by_them() -> None:
    shapes = {name: EffectorShape(shape.kind, shape.half_size_m) for name, shape in SHAPES.items()}
    report = validate_scenario(six_stairs(Stairs(1, 1.5)), shapes)
    assert report.valid
    assert "reach-unknown" in {remark.code for remark in report.remarks}
    assert all(margin.reach_m is None for margin in report.margins)
