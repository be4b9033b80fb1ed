"""Uploads as owners make them: whole folders with several sets of meshes, no meshes, links without mass, no ranges."""

import xml.etree.ElementTree as ET
from pathlib import Path, PurePosixPath

import numpy as np
import pinocchio as pin
import pytest

from stridelab.errors import InvalidInput
from stridelab.robots.proposal.archive import unpack_robot
from stridelab.robots.proposal.propose import propose_card, rebuild_description
from support.robots.humanoid import HALF_SOLE_M, Humanoid, archive, box_stl

FEET = Humanoid(mesh_feet="meshes/sole.stl")
SOLE, CUBE = box_stl((*HALF_SOLE_M, 0.02)), box_stl((0.5, 0.5, 0.5))


def rebuild_upload(folder: Path, content: bytes, filename: str = "small.zip") -> tuple[ET.Element, dict[str, str]]:
    """The rebuilt description of an upload, and what was assumed."""
    (folder / filename).write_bytes(content)
    assumed = rebuild_description(folder / filename, filename, "small", folder / "robots")
    return ET.fromstring((folder / "robots" / "small" / "robot.urdf").read_bytes()), assumed


def test_meshes_in_the_folders_of_the_description_are_used(tmp_path: Path) -> None:
    """A folder with a URDF and an MJCF file that have meshes of the same names each."""
    files = {"r/urdf/small.urdf": FEET.urdf(), "r/mjcf/meshes/sole.stl": CUBE, "r/urdf/meshes/sole.stl": SOLE}
    _, assumed = rebuild_upload(tmp_path, archive(files))
    card = propose_card("small", "small", tmp_path / "robots", assumed).card
    assert card.effectors["left_foot"].contact_half_size_m == pytest.approx(HALF_SOLE_M, abs=0.003)


@pytest.mark.parametrize("second", [SOLE, CUBE])
def test_meshes_that_are_equally_near_must_be_the_same(second: bytes, tmp_path: Path) -> None:
    files = {"r/small.urdf": FEET.urdf(), "r/a/meshes/sole.stl": SOLE, "r/b/meshes/sole.stl": second}
    if second == SOLE:
        plain, _ = rebuild_upload(tmp_path, archive(files))
        assert plain.find("link[@name='left_ankle_roll_link']/collision/geometry/mesh") is not None
        return
    with pytest.raises(InvalidInput) as refusal:
        rebuild_upload(tmp_path, archive(files))
    (fault,) = refusal.value.faults
    assert fault.where == "meshes/sole.stl"
    assert fault.message == "the zip has 2 such meshes, in r/a/meshes, r/b/meshes"


def test_a_description_without_its_meshes_is_refused_in_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(InvalidInput) as refusal:
        rebuild_upload(tmp_path, FEET.urdf().encode(), "small.urdf")
    (fault,) = refusal.value.faults
    assert fault.where == "meshes such as meshes/sole.stl"
    assert fault.message == "the description names 1 that are not in the upload; put both into one zip"


def test_a_description_is_chosen_by_the_end_of_its_name(tmp_path: Path) -> None:
    upload = tmp_path / "small.zip"
    upload.write_bytes(archive({"r/small_with_hands.urdf": "", "r/small_legs.urdf": "", "r/x/legs.urdf": ""}))
    for wanted, chosen in (("with_hands.urdf", "small_with_hands.urdf"), ("legs.urdf", "x/legs.urdf")):
        folder = tmp_path / wanted
        folder.mkdir()
        assert unpack_robot(upload, "small.zip", folder, wanted).inside == PurePosixPath("r", chosen)


@pytest.mark.parametrize("kind", ["continuous", "fixed"])
def test_a_world_of_no_mass_is_left_out(kind: str, tmp_path: Path) -> None:
    """Its joint is not one of the robot, whose base floats, and neither is what was assumed of it."""
    root = ET.fromstring(Humanoid().urdf())
    world = ET.SubElement(root, "link", name="World")
    inertial = ET.SubElement(world, "inertial")
    ET.SubElement(inertial, "mass", value="0")
    ET.SubElement(inertial, "inertia", dict.fromkeys(("ixx", "ixy", "ixz", "iyy", "iyz", "izz"), "0"))
    joint = ET.SubElement(root, "joint", name="anchor", type=kind)
    for which, link in (("parent", "World"), ("child", "pelvis")):
        ET.SubElement(joint, which, link=link)
    plain, assumed = rebuild_upload(tmp_path, archive({"small.urdf": ET.tostring(root, encoding="unicode")}))
    assert plain.find("link[@name='World']") is None
    assert plain.find("joint[@name='anchor']") is None
    left_out = {"joint anchor: type": "left out: it attaches the robot to a link without mass"}
    assert assumed == (left_out if kind == "continuous" else {})


def test_a_link_without_mass_between_joints_shares_that_of_the_next(tmp_path: Path) -> None:
    """Mass, CoM and inertia of the robot are the same in random configurations, since the two axes meet."""
    root = ET.fromstring(Humanoid().urdf())
    ET.SubElement(root, "link", name="cross")
    elbow = root.find("joint[@name='left_elbow']")
    assert elbow is not None
    (parent,) = elbow.findall("parent")
    above = ET.SubElement(root, "joint", name="left_twist", type="revolute")
    ET.SubElement(above, "parent", link=parent.attrib["link"])
    ET.SubElement(above, "child", link="cross")
    above.extend(elbow.findall("origin"))
    ET.SubElement(above, "axis", xyz="0 0 1")
    ET.SubElement(above, "limit", lower="-1", upper="1", effort="50", velocity="5")
    parent.set("link", "cross")
    for origin in elbow.findall("origin"):
        elbow.remove(origin)
    text = ET.tostring(root, encoding="unicode")
    _, assumed = rebuild_upload(tmp_path, archive({"small.urdf": text}))
    assert assumed["link cross: mass"] == "1 % of that of link left_elbow_link, since it states none"
    rebuilt = pin.buildModelFromUrdf(str(tmp_path / "robots" / "small" / "robot.urdf"), pin.JointModelFreeFlyer())
    stated = pin.buildModelFromXML(text, pin.JointModelFreeFlyer())
    assert list(rebuilt.names) == list(stated.names)
    assert rebuilt.inertias[rebuilt.getJointId("left_twist")].mass == pytest.approx(0.008)
    random = np.random.default_rng(1)
    for _ in range(5):
        q = pin.integrate(stated, pin.neutral(stated), random.uniform(-0.5, 0.5, stated.nv))
        bodies = []
        for model in (rebuilt, stated):
            data = model.createData()
            pin.ccrba(model, data, q, np.zeros(model.nv))
            bodies.append([data.Ig.mass, *data.com[0], *data.Ig.inertia.ravel()])
        np.testing.assert_allclose(bodies[0], bodies[1], atol=1e-12)


def test_a_range_of_a_wheel_is_that_of_a_joint_without_one(tmp_path: Path) -> None:
    """999999 rad is no unit of an angle; 200 may be degrees, and is refused."""
    root = ET.fromstring(Humanoid().urdf())
    limit = root.find("joint[@name='left_wrist']/limit")
    assert limit is not None
    limit.attrib.update(lower="-999999", upper="999999")
    _, assumed = rebuild_upload(tmp_path, archive({"small.urdf": ET.tostring(root, encoding="unicode")}))
    assert "joint left_wrist: range" in assumed
    limit.attrib.update(lower="-200", upper="200")
    (tmp_path / "again").mkdir()
    with pytest.raises(InvalidInput, match="the unit must be rad"):
        rebuild_upload(tmp_path / "again", archive({"small.urdf": ET.tostring(root, encoding="unicode")}))


def test_legs_that_slide_are_refused_with_the_names_of_the_joints(tmp_path: Path) -> None:
    root = ET.fromstring(Humanoid().urdf())
    for side in ("left", "right"):
        knee = root.find(f"joint[@name='{side}_knee']")
        assert knee is not None
        knee.set("type", "prismatic")
    _, assumed = rebuild_upload(tmp_path, archive({"small.urdf": ET.tostring(root, encoding="unicode")}))
    with pytest.raises(InvalidInput) as refusal:
        propose_card("small", "small", tmp_path / "robots", assumed)
    assert refusal.value.code == "robot-not-humanoid"
    (fault,) = refusal.value.faults
    assert fault.message.startswith("its legs have 5 joints; a sole needs 6 (")
    assert fault.message.endswith("; joints that slide are fixed, as 'left_knee', 'right_knee'")


def test_a_robot_without_pairs_of_limbs_is_refused_with_its_longest_chain(tmp_path: Path) -> None:
    root = ET.fromstring(Humanoid(arms=False).urdf())
    left = [joint for joint in root.findall("joint") if joint.attrib["name"].startswith("left")]
    links = {end.attrib["link"] for joint in left for end in joint.findall("child")}
    for element in [*left, *(link for link in root.findall("link") if link.attrib["name"] in links)]:
        root.remove(element)
    _, assumed = rebuild_upload(tmp_path, archive({"small.urdf": ET.tostring(root, encoding="unicode")}))
    with pytest.raises(InvalidInput, match="its longest chain of joints ends at 'right_ankle_roll'"):
        propose_card("small", "small", tmp_path / "robots", assumed)
