"""The first walk of a new robot: the bundled level walk, scaled. The whole job runs in the test of the service."""

from dataclasses import replace
from math import sqrt

import pytest

from stridelab.contacts.scenarios.stairs import STROLLING
from stridelab.errors import InvalidInput
from stridelab.pipelines.commissioning.commission_robot import STEP_M, com_height_m, foot_places_m, scaled_walk
from stridelab.robots.loader import load_robot


@pytest.mark.parametrize("name", ["talos", "hrp2", "g1"])
def test_lengths_scale_with_the_height_of_the_com_and_times_with_its_root(name: str) -> None:
    robot = load_robot(name)
    scale = com_height_m(robot) / com_height_m(load_robot("talos"))
    feet_y_m = foot_places_m(robot)
    scenario, step_m, step_time_s = scaled_walk(robot, feet_y_m, 1.0)
    assert step_m == pytest.approx(scale * STEP_M, rel=0.01)
    assert step_time_s == pytest.approx(sqrt(scale) * (STROLLING.move_s + STROLLING.rest_s), rel=0.02)
    froude = (step_m / step_time_s) ** 2 / (9.81 * com_height_m(robot))
    assert froude == pytest.approx((STEP_M / (STROLLING.move_s + STROLLING.rest_s)) ** 2 / (9.81 * 0.876), rel=0.04)
    assert scenario["robot"] == name
    y_m = {abs(contact["position_m"][1]) for phase in scenario["phases"] for contact in phase["contacts"]}
    assert max(y_m) - feet_y_m == pytest.approx(0.0, abs=1e-4)
    assert len(y_m) == 1


def test_shorter_steps_take_as_long() -> None:
    robot = load_robot("hrp2")
    _, long_m, long_s = scaled_walk(robot, 0.1, 1.0)
    _, short_m, short_s = scaled_walk(robot, 0.1, 0.45)
    assert short_m == pytest.approx(0.45 * long_m, abs=1e-3)
    assert short_s == long_s


def test_a_slower_walk_has_the_same_steps() -> None:
    robot = load_robot("hrp2")
    usual, step_m, step_s = scaled_walk(robot, 0.1, 0.45)
    slow, slow_m, slow_s = scaled_walk(robot, 0.1, 0.45, 0.65)
    assert slow_m == step_m
    assert slow_s == pytest.approx(step_s / 0.65, rel=0.02)
    places = [[phase["contacts"] for phase in walk["phases"]] for walk in (usual, slow)]
    assert places[0] == places[1]


def test_a_walk_needs_two_feet_by_name() -> None:
    robot = load_robot("hrp2")
    feet = {name.replace("foot", "sole"): effector for name, effector in robot.effectors.items()}
    with pytest.raises(InvalidInput) as refusal:
        foot_places_m(replace(robot, effectors=feet))
    assert refusal.value.code == "feet-missing"
