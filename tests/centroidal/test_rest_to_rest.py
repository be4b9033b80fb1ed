"""The problem that the planner poses of a robot and its contacts."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from stridelab.centroidal.problem import CentroidalProblem
from stridelab.centroidal.rest_to_rest import COM_LOWERING_M, RAIL_FRICTION_SHARE, from_rest_to_rest
from stridelab.centroidal.solver import solve
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


def test_half_of_the_friction_of_a_rail_is_kept_in_reserve() -> None:
    """A hand lands beside the middle of the bar; of a plan without the reserve it uses all friction."""

    def used_share(problem: CentroidalProblem) -> float:
        plan = solve(problem)
        assert plan.converged, plan.status
        contact = problem.contact("right_hand", 0)
        local = plan.forces_n["right_hand"].reshape(-1, 3) @ contact.placement.rotation
        pressing = local[local[:, 2] > 1.0]
        return float((np.linalg.norm(pressing[:, :2], axis=1) / (contact.friction * pressing[:, 2])).max())

    stairs = sequence_of(stairs_with_rail(Stairs(2, 0.15)), effector_shapes("talos"))
    problem = from_rest_to_rest(load_robot("talos"), stairs, {})
    assert used_share(problem) <= RAIL_FRICTION_SHARE + 1e-6
    assert used_share(replace(problem, rail_friction_share=1.0)) > 0.9
    assert problem.usable_friction("left_foot", 0) == problem.contact("left_foot", 0).friction
