"""The axes of the root link do not matter: a robot does the same whichever way its root link looks."""

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from stridelab.centroidal.problem import CentroidalProblem, standing_com_m
from stridelab.centroidal.solver import solve
from stridelab.contacts.effector_geometry import effector_shapes
from stridelab.contacts.scenario_io import sequence_of
from stridelab.contacts.scenarios.parts import Timing
from stridelab.dynamics.spatial import Placement
from stridelab.errors import InvalidInput
from stridelab.reachability.kinematics.ik_ground_truth import StanceTruth
from stridelab.reachability.kinematics.whole_body_ik import BASE, BodyTree
from stridelab.reachability.learning.com_sampling import sample_com
from stridelab.robots.assembly import assemble_robot, round_to_axes
from stridelab.robots.card import card_bytes, parse_card, robot_card
from stridelab.robots.contact_frames import with_contact_frames
from stridelab.robots.data_files import data_files
from stridelab.robots.inverse_kinematics import stand
from stridelab.robots.loader import load_robot, robot_names
from stridelab.robots.robot import Robot
from stridelab.wholebody.control.controller import WholeBodyController
from stridelab.wholebody.replay.replay import replay_with_defaults
from support.robots.scenario_bodies import com_height_m, one_normal, turned_hrp2, walk_of

TURNS = {"backwards": (0.0, 0.0, np.pi), "z ahead": (0.0, -np.pi / 2, 0.0), "askew": (0.5, 0.6, 2.1)}


@pytest.fixture(scope="module")
def usual() -> Robot:
    return load_robot("hrp2")


@pytest.fixture(scope="module", params=list(TURNS))
def turned(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Robot:
    R = pin.rpy.rpyToMatrix(*TURNS[request.param])
    robot = turned_hrp2(R, tmp_path_factory.mktemp("turned"))
    np.testing.assert_allclose(robot.R_root_trunk, R.T, atol=1e-9)
    return robot


def contacts(robot: Robot, q: np.ndarray) -> dict[str, Placement]:
    model, frames = with_contact_frames(robot)
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    return {name: Placement(data.oMf[k].translation.copy(), data.oMf[k].rotation.copy()) for name, k in frames.items()}


@pytest.mark.parametrize("name", robot_names())
def test_root_links_that_look_ahead_stay_as_they_are(name: str) -> None:
    robot = load_robot(name)
    assert np.array_equal(robot.R_root_trunk, np.eye(3))
    assert np.array_equal(robot.R_base_trunk, np.eye(3))
    assert robot.q_reference[3:7].tolist() == [0.0, 0.0, 0.0, 1.0]


def test_it_stands_on_the_same_places_in_the_reference_posture(usual: Robot, turned: Robot) -> None:
    there, here = contacts(usual, usual.q_reference), contacts(turned, turned.q_reference)
    for name in there:
        np.testing.assert_allclose(here[name].position_m, there[name].position_m, atol=1e-9)
        np.testing.assert_allclose(here[name].rotation, there[name].rotation, atol=1e-9)
    com_m, turned_com_m = (
        pin.centerOfMass(r.model, r.model.createData(), r.q_reference).copy() for r in (usual, turned)
    )
    np.testing.assert_allclose(com_m, turned_com_m, atol=1e-9)


@pytest.mark.parametrize("measure", ["uniform", "conditioned"])
def test_its_com_is_where_that_of_the_usual_one_is(usual: Robot, turned: Robot, measure: str) -> None:
    names = tuple(usual.effectors)
    there, here = (sample_com(robot, names, 60, 4, measure, processes=1) for robot in (usual, turned))
    assert here.tried == there.tried
    for name in names:
        # a leg is placed to 1e-6 m and rad, from whichever side
        np.testing.assert_allclose(here.com_m[name], there.com_m[name], atol=2e-5)


def test_inverse_kinematics_finds_the_same_posture(usual: Robot, turned: Robot) -> None:
    placements = contacts(usual, usual.q_reference)
    placements["right_foot"] = Placement.from_wxyz([0.2, -0.1, 0.1], [np.cos(0.1), 0.0, 0.0, -np.sin(0.1)])
    del placements["left_hand"]
    com_m = np.array([0.08, 0.0, 0.62])
    there, here = (stand(robot, placements, com_m) for robot in (usual, turned))
    assert there.converged
    assert here.converged
    np.testing.assert_allclose(here.q[7:], there.q[7:], atol=1e-5)
    np.testing.assert_allclose(here.q[:3], there.q[:3], atol=1e-5)


def test_the_body_tree_has_the_trunk_s_angles(usual: Robot, turned: Robot) -> None:
    there, here = BodyTree.from_robot(usual), BodyTree.from_robot(turned)
    x = np.random.default_rng(0).uniform(-0.5, 0.5, (5, len(there.links)))
    q = here.to_configurations(x)
    np.testing.assert_allclose(here.to_coordinates(q), x, atol=1e-9)
    np.testing.assert_allclose(
        here.com_and_jacobian(here.forward_kinematics(x))[0],
        there.com_and_jacobian(there.forward_kinematics(x))[0],
        atol=1e-9,
    )
    for k in range(5):
        placed, at = contacts(turned, q[k]), here.forward_kinematics(x)
        for name, contact in placed.items():
            p, R = here.contact_frame_pose(name, at)
            np.testing.assert_allclose(p[k], contact.position_m, atol=1e-9)
            np.testing.assert_allclose(R[k], contact.rotation, atol=1e-9)
    assert np.abs(here.to_coordinates(turned.q_reference[None])[0, 3:BASE]).max() < 1e-9


def test_postures_on_given_contacts_are_the_same(usual: Robot, turned: Robot) -> None:
    feet = {name: place for name, place in contacts(usual, usual.q_reference).items() if name.endswith("foot")}
    there, here = (StanceTruth(robot).sample_postures(feet, 5, 3) for robot in (usual, turned))
    np.testing.assert_allclose(here[:, 7:], there[:, 7:], atol=2e-5)


def test_a_robot_with_other_trunk_axes_walks_as_the_usual_one(usual: Robot, tmp_path: Path) -> None:
    """The whole body keeps the trunk upright, and the simulator falls neither way."""
    turned = turned_hrp2(pin.rpy.rpyToMatrix(*TURNS["backwards"]), tmp_path / "turned")
    sequence = sequence_of(walk_of(usual, 1, 0.15, Timing(0.8, 0.7, 0.2)), effector_shapes("hrp2"))
    height_m, proxies = 0.98 * com_height_m(usual), one_normal(usual)
    first, last = (standing_com_m(sequence.phases[i].contacts, height_m, usual.effectors) for i in (0, -1))
    plan = solve(CentroidalProblem(sequence, usual.mass_kg, usual.effectors, proxies, first, last))
    there, here = (WholeBodyController().run(robot, sequence, plan) for robot in (usual, turned))
    np.testing.assert_allclose(here.q[:, 7:], there.q[:, 7:], atol=1e-4)
    np.testing.assert_allclose(here.com_m, there.com_m, atol=1e-5)
    replayed = replay_with_defaults(turned, sequence, here, lambda *_: None)
    assert replayed.completed
    assert replayed.com_error_max_m < 0.01


def test_a_trunk_that_leans_keeps_its_own_axes() -> None:
    for rpy in ((0.2, 0.1, 0.0), (0.0, 0.3, np.pi - 0.1)):
        nearest = pin.rpy.rpyToMatrix(0.0, 0.0, np.pi * round(rpy[2] / np.pi))
        np.testing.assert_allclose(round_to_axes(pin.rpy.rpyToMatrix(*rpy)), nearest, atol=1e-12)
    askew = pin.rpy.rpyToMatrix(0.5, 0.6, 2.1)
    np.testing.assert_array_equal(round_to_axes(askew), askew)


def test_soles_that_look_away_from_each_other_are_refused() -> None:
    text = card_bytes("hrp2").decode()
    sole = "[effectors.left_foot]\n"
    assert sole in text
    for wxyz, what in (("[0.0, 0.0, 0.0, 1.0]", "x axes"), ("[0.0, 1.0, 0.0, 0.0]", "z axes")):
        card = parse_card("hrp2", text.replace(sole, f"{sole}orientation_wxyz = {wxyz}\n").encode())
        with pytest.raises(InvalidInput, match=what) as caught:
            assemble_robot("hrp2", card, data_files(robot_card("hrp2")))
        assert [fault.where for fault in caught.value.faults] == ["effectors"]
