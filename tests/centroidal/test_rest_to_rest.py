"""The problem that the planner poses of a robot and its contacts."""

import pinocchio as pin
import pytest

from stridelab.centroidal.rest_to_rest import COM_LOWERING_M, from_rest_to_rest
from stridelab.contacts.effector_geometry import effector_shapes
from stridelab.contacts.scenario_io import sequence_of
from stridelab.contacts.scenarios.hand_scenes import stand_up
from stridelab.contacts.scenarios.stairs import Stairs, stairs_with_rail
from stridelab.robots.loader import load_robot


def test_it_goes_from_standing_on_the_first_soles_to_standing_on_the_last() -> None:
    robot = load_robot("talos")
    problem = from_rest_to_rest(robot, sequence_of(stairs_with_rail(Stairs(2, 0.15)), effector_shapes("talos")), {})
    height_m = pin.centerOfMass(robot.model, robot.model.createData(), robot.q_reference)[2] - COM_LOWERING_M
    # the soles begin one depth before the foot of the stairs and end on the second
    assert problem.com_start_m == pytest.approx([-0.3, 0.0, height_m])
    assert problem.com_end_m == pytest.approx([0.6, 0.0, 0.3 + height_m])
    assert problem.mass_kg == pytest.approx(robot.mass_kg)
    assert problem.proxies == {}


def test_the_scenario_says_how_high_the_com_starts() -> None:
    robot = load_robot("talos")
    problem = from_rest_to_rest(robot, sequence_of(stand_up(0.65), effector_shapes("talos")), {})
    height_m = pin.centerOfMass(robot.model, robot.model.createData(), robot.q_reference)[2] - COM_LOWERING_M
    assert problem.com_start_m == pytest.approx([0.0, 0.0, 0.65])
    assert problem.com_end_m == pytest.approx([0.0, 0.0, height_m])
