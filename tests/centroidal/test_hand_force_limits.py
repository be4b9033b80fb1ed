"""The bound on a hand's force against the inverse dynamics of the whole robot with that force on its hand."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from experiments.bundled_scenarios import hrp2_stairs_with_rail
from stridelab.centroidal.boundary_conditions import PathBounds
from stridelab.centroidal.hand_force_limits import MIN_BOUND_N, TORQUE_SHARE, hand_bounds_n, max_normal_force_n
from stridelab.centroidal.solver import solve
from stridelab.contacts.effector_geometry import effector_shapes
from stridelab.contacts.scenario_io import sequence_of
from stridelab.contacts.scenarios.stairs import flat_walk
from stridelab.contacts.sequence import Contact
from stridelab.dynamics.spatial import Placement
from stridelab.robots.contact_frames import with_contact_frames
from stridelab.robots.loader import load_robot
from stridelab.robots.robot import Robot
from support.robots.sequences import rail_of_hrp2

ROBOTS = ("hrp2", "g1", "talos")


def held_out(robot: Robot, friction: float) -> Contact:
    """The right hand where the reference posture has it, on something level."""
    model, frames = with_contact_frames(robot)
    data = model.createData()
    pin.framesForwardKinematics(model, data, robot.q_reference)
    there = Placement.from_wxyz(data.oMf[frames["right_hand"]].translation.tolist())
    return Contact("right_hand", there, "rail", friction, "point")


def ratios(robot: Robot, contact: Contact, force_n: np.ndarray) -> np.ndarray:
    """Torque and friction over limit of every joint of the arms, by Newton and Euler with the hand's force."""
    model, frames = with_contact_frames(robot)
    data = model.createData()
    pin.framesForwardKinematics(model, data, robot.q_reference)
    joint = model.frames[frames[contact.effector]].parentJoint
    at = contact.placement.position_m
    on_world = pin.Force(force_n, np.cross(at, force_n))
    external = pin.StdVec_Force()
    external.extend(
        [data.oMi[joint].actInv(on_world) if i == joint else pin.Force.Zero() for i in range(model.njoints)]
    )
    tau = pin.rnea(model, data, robot.q_reference, np.zeros(model.nv), np.zeros(model.nv), external)
    arm = [i for i, name in enumerate(robot.joint_names) if robot.group[name] == "arm"]
    return np.asarray((np.abs(tau[6:][arm]) + model.friction[6:][arm]) / model.effortLimit[6:][arm])


@pytest.mark.parametrize("friction", [0.1, 0.6])
@pytest.mark.parametrize("name", ROBOTS)
def test_the_limit_can_be_carried_and_hardly_more(name: str, friction: float) -> None:
    robot = load_robot(name)
    contact = held_out(robot, friction)
    most_n = max_normal_force_n(robot, robot.q_reference, contact)
    around = np.linspace(0.0, 2.0 * np.pi, 48, endpoint=False)
    cone = [np.array([friction * np.cos(a), friction * np.sin(a), 1.0]) for a in around]
    worst = max(ratios(robot, contact, most_n * ray).max() for ray in cone)
    assert worst <= TORQUE_SHARE + 1e-9
    assert worst > 0.9 * TORQUE_SHARE  # the pyramid about the cone is 1 / cos(pi / 8) wider
    assert max(ratios(robot, contact, 1.3 * most_n * ray).max() for ray in cone) > TORQUE_SHARE


def test_an_arm_without_strength_carries_nothing() -> None:
    robot = load_robot("hrp2")
    weak = pin.Model(robot.model)
    weak.effortLimit = 1e-3 * robot.model.effortLimit
    assert max_normal_force_n(replace(robot, model=weak), robot.q_reference, held_out(robot, 0.3)) == 0.0
    assert MIN_BOUND_N > 0.0


def test_more_friction_raises_the_limit() -> None:
    robot = load_robot("hrp2")
    bears = [max_normal_force_n(robot, robot.q_reference, held_out(robot, friction)) for friction in (0.1, 0.3, 0.6)]
    assert bears == sorted(bears, reverse=True)


def test_the_hand_on_a_rail_is_bounded_and_feet_are_not() -> None:
    robot = load_robot("hrp2")
    shapes = effector_shapes("hrp2")
    bounds = hand_bounds_n(robot, sequence_of(hrp2_stairs_with_rail(), shapes))
    assert set(bounds) == {"right_hand"}
    assert 20.0 < bounds["right_hand"] < 150.0
    assert hand_bounds_n(load_robot("talos"), sequence_of(flat_walk(), effector_shapes("talos"))) == {}


def test_a_plan_respects_the_hand_force_limit() -> None:
    problem = rail_of_hrp2()
    tight = {"right_hand": 10.0}  # less than it would take
    plan = solve(replace(problem, bounds=PathBounds(normal_force_max_n=tight)))
    assert plan.converged
    normals = [
        float((f @ contact.placement.rotation)[:, 2].max())
        for f, phase in zip(plan.forces_n["right_hand"], plan.phase, strict=True)
        if (contact := plan.sequence.phases[phase].contacts.get("right_hand")) is not None
    ]
    assert max(normals) <= 10.0 + 1e-6
    assert max(normals) > 9.0
