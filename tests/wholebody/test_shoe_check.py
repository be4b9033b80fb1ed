"""Planned stances whose shoes have no room are refused, naming the other part and the distance."""

import math
from typing import Any

import pytest

from experiments.terrains.steps import Pose, Steps, wide_ground
from stridelab.contacts.effector_geometry import effector_shapes
from stridelab.contacts.scenario_io import sequence_of
from stridelab.contacts.scenarios.parts import HRP2, TALOS, Scenario, Timing, Walker, box
from stridelab.errors import InvalidInput
from stridelab.robots.loader import load_robot
from stridelab.robots.robot import Robot
from stridelab.wholebody.shoe_check import require_room_for_shoes

TIMING = Timing(1.0, 1.0, 0.2)


def turn(walker: Walker, turn_deg: float, terrain: list[dict[str, Any]] | None = None) -> Scenario:
    """Both feet side by side, then the left one turned by an angle about the middle."""
    steps = Steps.from_pose(walker, TIMING, Pose(0.0, 0.0))
    steps.move_foot("left_foot", Pose(0.0, 0.0, math.radians(turn_deg)))
    return steps.as_scenario("turn", "", [wide_ground(), *(terrain or [])])


def require_room(robot: Robot, scenario: Scenario) -> None:
    require_room_for_shoes(robot, sequence_of(scenario, effector_shapes(robot.name)))


@pytest.mark.parametrize("walker", [TALOS, HRP2])
def test_shoes_that_overlap_are_refused_although_their_soles_do_not(walker: Walker) -> None:
    robot = load_robot(walker.robot)
    require_room(robot, turn(walker, 20.0))
    with pytest.raises(InvalidInput) as refused:
        require_room(robot, turn(walker, 30.0))
    assert refused.value.code == "scenario-invalid"
    (fault,) = refused.value.faults
    assert fault.where == "phases[2].contacts[right_foot]"
    assert "overlaps with that of left_foot by" in fault.message


@pytest.mark.parametrize(("gap_m", "has_room"), [(0.035, True), (0.005, False)])
def test_a_shoe_needs_the_clearance_of_the_certificate_from_a_step(talos: Robot, gap_m: float, has_room: bool) -> None:
    toe_m = 0.105
    step = box("step", (toe_m + gap_m, 1.0), (-0.6, 0.6), (0.0, 0.15))
    if has_room:
        require_room(talos, turn(TALOS, 0.0, [step]))
        return
    with pytest.raises(InvalidInput) as refused:
        require_room(talos, turn(TALOS, 0.0, [step]))
    assert all("mm from 'step'" in fault.message for fault in refused.value.faults)
    assert {fault.where for fault in refused.value.faults} >= {
        "phases[0].contacts[left_foot]",
        "phases[0].contacts[right_foot]",
    }
