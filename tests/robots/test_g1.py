"""G1 as loaded from the installed package, against its URDF and its own meshes."""

import xml.etree.ElementTree as ET
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from stridelab.robots.assembly import assemble_robot
from stridelab.robots.card import robot_card
from stridelab.robots.contact_frames import with_contact_frames
from stridelab.robots.data_files import data_files
from stridelab.robots.loader import load_robot
from stridelab.robots.robot import Robot
from stridelab.robots.self_collision import SelfCollision


@pytest.fixture(scope="module")
def g1() -> Robot:
    return load_robot("g1")


def test_mass_joints_and_limits_are_those_of_the_urdf(g1: Robot) -> None:
    root = ET.parse(g1.urdf).getroot()
    assert g1.mass_kg == pytest.approx(sum(float(mass.attrib["value"]) for mass in root.iter("mass")), rel=1e-9)
    limits = {joint.attrib["name"]: joint.find("limit") for joint in root.iterfind("joint")}
    assert len(g1.joint_names) == 29
    for i, joint in enumerate(g1.joint_names):
        limit = limits[joint]
        assert limit is not None
        assert g1.model.lowerPositionLimit[7 + i] == pytest.approx(float(limit.attrib["lower"]))
        assert g1.model.upperPositionLimit[7 + i] == pytest.approx(float(limit.attrib["upper"]))
        assert g1.model.effortLimit[6 + i] == pytest.approx(float(limit.attrib["effort"]))


def test_the_reference_posture_is_balanced_on_the_collision_spheres(g1: Robot) -> None:
    """The lowest points of the spheres under the ankles are on the ground, and hold the rectangle of the card."""
    data = g1.model.createData()
    pin.framesForwardKinematics(g1.model, data, g1.q_reference)
    model, index = with_contact_frames(g1)
    placed = model.createData()
    pin.framesForwardKinematics(model, placed, g1.q_reference)
    for side in ("left", "right"):
        ankle = data.oMf[g1.model.getFrameId(f"{side}_ankle_roll_link")]
        link = next(i for i in ET.parse(g1.urdf).iterfind("link") if i.attrib["name"] == f"{side}_ankle_roll_link")
        origins = [part.find("origin") for part in link.iterfind("collision")]
        radii_m = {float(sphere.attrib["radius"]) for sphere in link.iter("sphere")}
        centres_m = np.array(
            [[float(x) for x in origin.attrib["xyz"].split()] for origin in origins if origin is not None]
        )
        assert centres_m.shape == (4, 3)
        heights_m = [ankle.act(centre)[2] - radii_m.copy().pop() for centre in centres_m]
        assert np.abs(heights_m).max() < 1e-6
        corners = [
            (placed.oMf[index[f"{side}_foot"]]).act(corner) for corner in g1.effectors[f"{side}_foot"].points_m()
        ]
        inside = np.array([ankle.actInv(corner) for corner in corners])
        for x, y, _ in inside:
            across = np.interp(x, [-0.05, 0.12], [0.025, 0.03])
            assert -0.05 - 1e-9 <= x <= 0.12 + 1e-9
            assert abs(y) <= across + 1e-9
    com_m = pin.centerOfMass(g1.model, data, g1.q_reference)
    assert np.abs(com_m[:2]).max() < 0.002
    assert com_m[2] == pytest.approx(0.6755, abs=1e-3)


def test_the_hands_are_level_enough_to_rest_on_a_rail(g1: Robot) -> None:
    model, index = with_contact_frames(g1)
    data = model.createData()
    pin.framesForwardKinematics(model, data, g1.q_reference)
    left, right = data.oMf[index["left_hand"]], data.oMf[index["right_hand"]]
    mirror = np.diag([1.0, -1.0, 1.0])
    assert left.translation == pytest.approx(mirror @ right.translation, abs=1e-4)
    for hand in (left, right):
        assert hand.rotation[0, 0] > 0.85
        assert hand.rotation[2, 2] > 0.85


def test_feet_hands_and_pelvis_collide_by_their_visual_shapes(g1: Robot) -> None:
    """The description gives them no collision shape, or four balls of 5 mm."""
    links = {g1.model.frames[part.parentFrame].name for part in g1.collision.geometryObjects}
    assert {"left_ankle_roll_link", "right_ankle_roll_link", "left_rubber_hand", "right_rubber_hand", "pelvis"} <= links
    assert not SelfCollision(g1).any_collision(g1.q_reference)


def test_hulls_collide_where_the_meshes_do(g1: Robot) -> None:
    """99.5 % over 1500 configurations."""
    card = robot_card("g1")
    raw = assemble_robot("g1", replace(card, collision=replace(card.collision, meshes=(".*",))), data_files(card))
    assert raw.sha256 != g1.sha256
    meshes, hulls, rng = SelfCollision(raw), SelfCollision(g1), np.random.default_rng(8)
    q, verdicts = g1.q_reference.copy(), []
    for _ in range(300):
        q[7:] = rng.uniform(g1.model.lowerPositionLimit[7:], g1.model.upperPositionLimit[7:])
        verdicts.append((meshes.any_collision(q), hulls.any_collision(q)))
    truth, by_hulls = np.array(verdicts).T
    assert 0.7 < truth.mean() < 0.85
    assert np.mean(truth & ~by_hulls) < 0.005
    assert np.mean(by_hulls & ~truth) < 0.025
