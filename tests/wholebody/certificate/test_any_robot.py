"""A new robot is a file, not code: the others walk like TALOS, are certified and stay upright in physics."""

from dataclasses import replace

import coal
import mujoco
import numpy as np
import pinocchio as pin
import pytest

from stridelab.centroidal.problem import CentroidalProblem, standing_com_m
from stridelab.centroidal.solver import solve
from stridelab.contacts.effector_geometry import effector_shapes
from stridelab.contacts.scenario_io import sequence_of
from stridelab.contacts.scenarios.parts import Timing
from stridelab.contacts.scenarios.stairs import six_stairs
from stridelab.contacts.terrain import Terrain
from stridelab.robots.loader import load_robot, robot_names
from stridelab.wholebody.certificate import clearance
from stridelab.wholebody.certificate.certify import certify
from stridelab.wholebody.control.controller import WholeBodyController
from stridelab.wholebody.replay.mujoco_model import build_simulation
from stridelab.wholebody.replay.replay import replay_with_defaults
from support.robots.scenario_bodies import com_height_m, one_normal, walk_of

STEP_M = {"hrp2": 0.2, "g1": 0.15}


@pytest.mark.parametrize("name", sorted(set(robot_names()) - {"talos"}))
def test_every_robot_walks_is_certified_and_stays_upright(name: str) -> None:
    robot = load_robot(name)
    sequence = sequence_of(walk_of(robot, 2, STEP_M[name], Timing(0.8, 0.7, 0.2)), effector_shapes(name))
    height_m, proxies = 0.98 * com_height_m(robot), one_normal(robot)
    first, last = (standing_com_m(sequence.phases[i].contacts, height_m, robot.effectors) for i in (0, -1))
    plan = solve(CentroidalProblem(sequence, robot.mass_kg, robot.effectors, proxies, first, last))
    assert plan.converged
    motion = WholeBodyController().run(robot, sequence, plan)
    certificate = certify(robot, sequence, plan, proxies, motion)
    assert [check for check in certificate.checks if not check.passed] == []
    replayed = replay_with_defaults(robot, sequence, motion, lambda *_: None)
    assert replayed.completed
    assert replayed.com_error_max_m < 0.01
    assert replayed.torque_ratio_max < 1.0


@pytest.mark.parametrize("name", ["hrp2", "g1"])
def test_the_simulated_robot_is_the_planned_one(name: str) -> None:
    """Mass, torque limits of the card, and all shapes with their extents."""
    robot = load_robot(name)
    built = build_simulation(robot, Terrain.from_surfaces([]), 0.7, ("left_foot", "right_foot"))
    assert mujoco.mj_getTotalmass(built.model) == pytest.approx(robot.mass_kg, rel=1e-6)
    assert built.torque_limit_nm[built.moving_actuator] == pytest.approx(robot.model.effortLimit[6:])
    for i, joint in enumerate(robot.joint_names):
        assert not built.model.jnt_actfrclimited[built.model.joint(joint).id], (
            "a limit of the URDF would hold beside the card's"
        )
        low, high = robot.model.lowerPositionLimit[7 + i], robot.model.upperPositionLimit[7 + i]
        assert built.model.joint(joint).range == pytest.approx([low, high])
    for part in robot.collision.geometryObjects:
        geom = built.model.geom(f"shape {part.name}")
        if isinstance(part.geometry, coal.Box):
            assert geom.size == pytest.approx(part.geometry.halfSide)
        elif isinstance(part.geometry, coal.Cylinder):
            assert geom.size[:2] == pytest.approx([part.geometry.radius, part.geometry.halfLength])
        else:
            assert np.ptp(np.asarray(part.geometry.points()), axis=0).max() > 0.01
            assert geom.type == mujoco.mjtGeom.mjGEOM_MESH


def test_every_shape_of_a_robot_is_held_against_every_surface() -> None:
    """Many shapes and many surfaces: the geometry grows in memory while its shapes are read."""
    robot = load_robot("hrp2")
    sequence = sequence_of(six_stairs() | {"robot": "hrp2"}, effector_shapes("hrp2"))
    result = clearance._Scene.build_scene(robot, sequence)
    links = [robot.model.frames[part.parentFrame].name for part in robot.collision.geometryObjects]
    surfaces = [surface.name for surface in sequence.terrain.surfaces]
    assert [(result.parts[pair.column], pair.surface) for pair in result.pairs] == [
        (link, surface) for surface in surfaces for link in links
    ]


def test_a_shape_that_can_touch_nothing_is_simulated_as_well() -> None:
    """As of a plate under a foot: the box of the sole stands on the ground in its place, and no pair is checked."""
    robot = load_robot("g1")
    geometry = robot.full_collision.copy()
    foot = robot.effectors["left_foot"]
    frame = robot.model.frames[robot.model.getFrameId(foot.frame)]
    at = pin.SE3(foot.T_frame_contact.rotation, foot.T_frame_contact.position_m)
    plate = pin.GeometryObject(
        "plate", frame.parentJoint, robot.model.getFrameId(foot.frame), frame.placement * at, coal.Box(0.1, 0.04, 0.001)
    )
    geometry.addGeometryObject(plate)
    own = robot.collision.copy()
    own.addGeometryObject(plate)
    built = build_simulation(
        replace(robot, full_collision=geometry, collision=own),
        Terrain.from_surfaces([]),
        0.7,
        ("left_foot", "right_foot"),
    )
    assert built.link[built.model.geom("shape plate").id] == foot.frame
