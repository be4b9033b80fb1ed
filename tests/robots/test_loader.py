"""TALOS as loaded, against figures that do not come from this project's code."""

import xml.etree.ElementTree as ET
from pathlib import Path

import coal
import numpy as np
import pinocchio as pin
import pytest

from stridelab.errors import Unavailable
from stridelab.robots import urdf
from stridelab.robots.assembly import robot_sha256
from stridelab.robots.card import card_bytes, parse_card, robot_card
from stridelab.robots.data_files import DataFiles, data_files
from stridelab.robots.loader import load_robot, robot_names
from stridelab.robots.part_names import part_words
from stridelab.robots.robot import Robot


@pytest.fixture(scope="module")
def talos() -> Robot:
    return load_robot("talos")


def contact(robot: Robot, effector: str) -> pin.SE3:
    """T_world_contact in the reference posture, by pinocchio's own frames."""
    data = robot.model.createData()
    pin.framesForwardKinematics(robot.model, data, robot.q_reference)
    own = robot.effectors[effector]
    T_frame_contact = pin.SE3(own.T_frame_contact.rotation, own.T_frame_contact.position_m)
    return data.oMf[robot.model.getFrameId(own.frame)] * T_frame_contact


def test_a_robot_is_loaded_once(talos: Robot) -> None:
    assert robot_names() == ("g1", "hrp2", "talos")
    assert load_robot("talos") is talos


def test_masses_are_those_of_the_urdf(talos: Robot) -> None:
    masses = [float(mass.attrib["value"]) for mass in ET.parse(talos.urdf).iter("mass")]
    assert talos.mass_kg == pytest.approx(sum(masses), rel=1e-9)
    assert talos.mass_kg == pytest.approx(90.27, abs=0.005)


def test_limits_are_those_of_the_urdf(talos: Robot) -> None:
    limits = {joint.attrib["name"]: joint.find("limit") for joint in ET.parse(talos.urdf).iterfind("joint")}
    assert len(talos.joint_names) == 28
    for i, joint in enumerate(talos.joint_names):
        limit = limits[joint]
        assert limit is not None
        assert talos.model.lowerPositionLimit[7 + i] == pytest.approx(float(limit.attrib["lower"]), abs=1e-12)
        assert talos.model.upperPositionLimit[7 + i] == pytest.approx(float(limit.attrib["upper"]), abs=1e-12)
        assert talos.model.velocityLimit[6 + i] == pytest.approx(float(limit.attrib["velocity"]))
        assert talos.model.effortLimit[6 + i] == pytest.approx(float(limit.attrib["effort"]))


def test_it_stands_on_flat_soles_around_the_origin(talos: Robot) -> None:
    feet = [contact(talos, name) for name in ("left_foot", "right_foot")]
    for name, foot in zip(("left_foot", "right_foot"), feet, strict=True):
        corners = talos.effectors[name].points_m()
        assert np.abs([foot.act(corner)[2] for corner in corners]).max() < 1e-6
        assert foot.rotation == pytest.approx(np.eye(3), abs=1e-6)
    assert feet[0].translation + feet[1].translation == pytest.approx(np.zeros(3), abs=1e-12)
    assert feet[0].translation == pytest.approx([0.0, 0.085, 0.0], abs=1e-6)


def test_its_com_is_above_the_soles_at_the_known_height(talos: Robot) -> None:
    com_m = pin.centerOfMass(talos.model, talos.model.createData(), talos.q_reference)
    assert com_m[2] == pytest.approx(0.877, abs=1e-3)
    assert np.abs(com_m[:2]).max() < 0.01


def test_the_lowest_vertices_of_the_feet_lie_on_the_ground(talos: Robot) -> None:
    """The soles are where the meshes say, not only where the frames say."""
    data, hulls = talos.model.createData(), talos.collision.createData()
    pin.updateGeometryPlacements(talos.model, data, talos.collision, hulls, talos.q_reference)
    for side in ("left", "right"):
        foot = talos.collision.getGeometryId(f"leg_{side}_6_link_0")
        points = talos.collision.geometryObjects[foot].geometry.points()
        heights_m = [hulls.oMg[foot].act(point)[2] for point in points]
        assert min(heights_m) == pytest.approx(0.0, abs=1.5e-3)


def test_hands_touch_with_x_forwards_along_a_bar_and_z_away_from_it(talos: Robot) -> None:
    left, right = contact(talos, "left_hand"), contact(talos, "right_hand")
    for hand in (left, right):
        assert hand.rotation[0, 0] > 0.85
        assert hand.rotation[2, 2] > 0.85
    mirror = np.diag([1.0, -1.0, 1.0])
    assert left.translation == pytest.approx(mirror @ right.translation, abs=1e-6)
    assert left.rotation == pytest.approx(mirror @ right.rotation @ mirror, abs=1e-6)
    data = talos.model.createData()
    pin.framesForwardKinematics(talos.model, data, talos.q_reference)
    gripper = data.oMf[talos.model.getFrameId("gripper_right_base_link")]
    assert gripper.actInv(right.translation) == pytest.approx([0.0, 0.0, -0.11], abs=1e-12)


def test_ankles_are_the_joints_next_to_the_sole(talos: Robot) -> None:
    model = talos.model
    for name in ("left_foot", "right_foot"):
        effector = talos.effectors[name]
        assert effector.ankle is not None
        pitch, roll = (model.getJointId(joint) for joint in effector.ankle)
        assert model.frames[model.getFrameId(effector.frame)].parentJoint == roll
        assert model.parents[roll] == pitch
        assert (model.joints[pitch].shortname(), model.joints[roll].shortname()) == ("JointModelRY", "JointModelRX")


def test_grippers_and_head_are_locked_and_every_other_joint_lies_in_a_group(talos: Robot) -> None:
    assert talos.locked == dict.fromkeys(
        ("gripper_left_joint", "gripper_right_joint", "head_1_joint", "head_2_joint"), 0.0
    )
    assert set(talos.group) == set(talos.joint_names)
    sizes = {group: list(talos.group.values()).count(group) for group in set(talos.group.values())}
    assert sizes == {"leg": 12, "torso": 2, "arm": 14}


def test_rotor_inertia_is_that_of_the_srdf(talos: Robot) -> None:
    srdf = data_files(robot_card("talos")).srdf
    rotors = {
        joint.attrib["name"]: float(joint.attrib["mass"]) * float(joint.attrib["gear_ratio"]) ** 2
        for joint in ET.parse(srdf).iterfind("rotor_params/joint")
    }
    assert talos.model.armature[6:] == pytest.approx([rotors[joint] for joint in talos.joint_names])
    assert not talos.model.armature[:6].any()


def test_collision_pairs_are_those_that_the_srdf_leaves(talos: Robot) -> None:
    srdf = data_files(robot_card("talos")).srdf
    parts = list(talos.collision.geometryObjects)
    names = [str(talos.model.frames[part.parentFrame].name) for part in parts]
    disabled = {
        frozenset((pair.attrib["link1"], pair.attrib["link2"])) for pair in ET.parse(srdf).iter("disable_collisions")
    }
    remaining_pairs = {frozenset((names[pair.first], names[pair.second])) for pair in talos.collision.collisionPairs}
    assert not remaining_pairs & disabled
    assert len(remaining_pairs) == len(talos.collision.collisionPairs) == 296
    assert len(parts) == 33
    assert not [name for name in names if "finger" in name or "_ft_" in name or "rgbd" in name]


def test_hulls_contain_their_meshes_and_are_convex(talos: Robot) -> None:
    full = urdf.full_model(talos.urdf)
    originals = {
        part.name: part for part in urdf.collision_geometry(full, talos.urdf, talos.package_dirs).geometryObjects
    }
    for part in talos.collision.geometryObjects:
        mesh, hull = originals[part.name].geometry, part.geometry
        assert isinstance(mesh, coal.BVHModelBase)
        points = np.array(hull.points())
        corners = np.array([[hull.polygons(i)[k] for k in range(3)] for i in range(hull.num_polygons)])
        a, b, c = (points[corners[:, k]] for k in range(3))
        normals = np.cross(b - a, c - a)
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        normals *= np.sign(np.sum(normals * (a - points.mean(axis=0)), axis=1, keepdims=True))
        outside_m = (np.array(mesh.vertices()) @ normals.T - np.sum(normals * a, axis=1)).max()
        assert outside_m < 1e-6, part.name
        assert {tuple(point) for point in points.round(9)} <= {tuple(v) for v in np.array(mesh.vertices()).round(9)}


def test_the_hash_depends_on_what_changes_the_robot(talos: Robot) -> None:
    files = data_files(robot_card("talos"))
    text = card_bytes("talos")
    relaid = parse_card(
        "talos", b"# a remark\n" + text.replace(b'title = "TALOS"', b'title = "T"').replace(b" = ", b"=")
    )
    assert robot_sha256(relaid, files, talos.collision) == talos.sha256
    moved = parse_card("talos", text.replace(b"position_m = [0.0, 0.0, -0.11]", b"position_m = [0.0, 0.0, -0.12]"))
    assert robot_sha256(moved, files, talos.collision) != talos.sha256


def test_the_hash_covers_every_file(talos: Robot, tmp_path: Path) -> None:
    """A byte more in the URDF, in the SRDF or in a mesh is another robot; where the files lie makes no difference."""
    card, files = robot_card("talos"), data_files(robot_card("talos"))
    assert files.srdf is not None
    mesh = Path(next(part.meshPath for part in talos.collision.geometryObjects))

    def hashed(urdf: bytes = b"", srdf: bytes = b"", triangles: bytes = b"") -> str:
        for name, path, more in (("urdf", files.urdf, urdf), ("srdf", files.srdf, srdf), ("mesh", mesh, triangles)):
            (tmp_path / name).write_bytes(path.read_bytes() + more)
        geometry = talos.collision.copy()
        geometry.geometryObjects[0].meshPath = str(tmp_path / "mesh")
        return robot_sha256(card, DataFiles(tmp_path / "urdf", tmp_path / "srdf", tmp_path), geometry)

    same = hashed()
    assert len({same, hashed(urdf=b" "), hashed(srdf=b" "), hashed(triangles=b" ")}) == 4
    assert hashed() == same


def test_a_broken_description_is_unavailable(tmp_path: Path, talos: Robot) -> None:
    broken, without = tmp_path / "broken.urdf", tmp_path / "without.urdf"
    broken.write_text("<robot name='x'><link name='a'>")
    without.write_text(talos.urdf.read_text().replace("torso/base_link_collision.STL", "torso/nowhere.STL"))
    with pytest.raises(Unavailable) as caught:
        urdf.full_model(broken)
    assert caught.value.code == "robot-data-unreadable"
    assert "line 1" in caught.value.message
    with pytest.raises(Unavailable, match=r"without\.urdf.*nowhere") as caught:
        urdf.collision_geometry(urdf.full_model(without), without, talos.package_dirs)
    assert caught.value.code == "robot-meshes-missing"
    assert [fault.where.rpartition("/")[2] for fault in caught.value.faults] == ["nowhere.STL"]
    with pytest.raises(Unavailable):
        urdf.read_srdf(talos.model.copy(), broken)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("leg_left_4_joint", "left knee"),
        ("RLEG_JOINT3", "right knee"),
        ("arm_right_7_joint", "right second wrist"),
        ("left_ankle_roll_joint", "left ankle roll"),
        ("torso_1_link_0", "torso 1"),
        ("CHEST_LINK0_3", "chest 0"),
        ("leg_left_9_joint", "leg left 9"),
        ("left_foot", "left foot"),
        ("waist_yaw_joint", "waist yaw"),
    ],
)
def test_joints_and_links_have_names_in_words(name: str, words: str) -> None:
    assert part_words(name) == words


@pytest.mark.parametrize("name", robot_names())
def test_no_two_joints_of_a_robot_have_the_same_words(name: str) -> None:
    names = [part_words(joint) for joint in load_robot(name).joint_names]
    assert len(set(names)) == len(names)
