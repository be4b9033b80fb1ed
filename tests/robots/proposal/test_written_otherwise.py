"""What descriptions write otherwise than the usual one: names, file names, points, limits that are none, meshes."""

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest

from stridelab.errors import InvalidInput
from stridelab.robots.card import parse_card
from stridelab.robots.proposal.propose import card_toml, propose_card, rebuild_description
from support.robots.humanoid import HALF_SOLE_M, SOLE_AHEAD_M, SOLE_DROP_M, Humanoid, archive, box_stl


def rebuilt(urdf: str, folder: Path, files: dict[str, bytes] | None = None) -> tuple[ET.Element, dict[str, str]]:
    """The rebuilt description of ``urdf`` in a zip with ``files``, and what was assumed."""
    (folder / "upload").write_bytes(archive({"small/urdf/small.urdf": urdf, **(files or {})}))
    assumed = rebuild_description(folder / "upload", "small.zip", "small", folder / "robots")
    return ET.fromstring((folder / "robots" / "small" / "robot.urdf").read_bytes()), assumed


def with_shape(link: str, kind: str, tag: str, **attributes: str) -> str:
    """The usual robot with one more shape of a link."""
    root = ET.fromstring(Humanoid().urdf())
    element = root.find(f"link[@name='{link}']")
    assert element is not None
    ET.SubElement(ET.SubElement(ET.SubElement(element, kind), "geometry"), tag, attributes)
    return ET.tostring(root, encoding="unicode")


def test_slashes_in_names_are_replaced(tmp_path: Path) -> None:
    """As by simulations of several robots: robot/link."""
    text = Humanoid().urdf().replace("left_knee", "one/left_knee")
    plain, assumed = rebuilt(text, tmp_path)
    assert plain.find("joint[@name='one_left_knee']/child[@link='one_left_knee_link']") is not None
    assert assumed["joint one_left_knee: name"] == "with _ in place of /"
    proposal = propose_card("small", "small", tmp_path / "robots", assumed)
    assert proposal.robot.group["one_left_knee"] == "leg"


def test_names_that_are_the_same_without_slashes_are_refused(tmp_path: Path) -> None:
    text = Humanoid().urdf().replace('joint name="left_knee"', 'joint name="left/hip_roll"')
    with pytest.raises(InvalidInput) as refusal:
        rebuilt(text, tmp_path)
    assert [fault.message for fault in refusal.value.faults] == ["its name occurs more than once"]


def test_meshes_are_matched_without_regard_to_case(tmp_path: Path) -> None:
    """Descriptions from file systems that know no case: only if no file has the same letters."""
    sole, cube = box_stl((*HALF_SOLE_M, 0.02)), box_stl((1.0, 1.0, 1.0))
    (tmp_path / "one").mkdir()
    humanoid = Humanoid(mesh_feet="package://small/meshes/Sole.STL")
    _, assumed = rebuilt(humanoid.urdf(), tmp_path / "one", {"small/meshes/sole.stl": sole})
    proposal = propose_card("small", "small", tmp_path / "one" / "robots", assumed)
    assert proposal.card.effectors["left_foot"].contact_half_size_m == pytest.approx(HALF_SOLE_M, abs=0.003)
    (tmp_path / "two").mkdir()
    files = {"small/meshes/sole.stl": cube, "Sole.STL": sole}
    rebuilt(humanoid.urdf(), tmp_path / "two", files)
    written = (tmp_path / "two" / "robots" / "small" / "mesh-0000.stl").read_bytes()
    assert len(written) == len(sole)
    assert max(abs(float(x)) for x in _corners(written)) == pytest.approx(HALF_SOLE_M[0])


def _corners(stl: bytes) -> list[float]:
    record = np.dtype([("normal", "<f4", 3), ("corners", "<f4", 9), ("attribute", "<u2")])
    return [float(x) for x in np.frombuffer(stl, record, offset=84)["corners"].ravel()]


@pytest.mark.parametrize("kind", ["collision", "visual"])
def test_spheres_of_radius_0_are_points(kind: str, tmp_path: Path) -> None:
    """As some descriptions mark the contact points of a foot; other shapes of size 0 are faults."""
    link = "left_ankle_roll_link"
    plain, assumed = rebuilt(with_shape(link, kind, "sphere", radius="0.0"), tmp_path)
    assert plain.find(f"link[@name='{link}']/{kind}/geometry/sphere") is None
    assert plain.find(f"link[@name='{link}']/{kind}/geometry/box") is not None
    assert "mark points" in assumed[f"link {link}: {kind}"]


@pytest.mark.parametrize(("tag", "attributes"), [("box", {"size": "0.1 0 0.1"}), ("sphere", {"radius": "-0.1"})])
def test_other_shapes_without_a_size_are_refused(tag: str, attributes: dict[str, str], tmp_path: Path) -> None:
    with pytest.raises(InvalidInput) as refusal:
        rebuilt(with_shape("torso", "collision", tag, **attributes), tmp_path)
    assert refusal.value.faults[0].message == f"its {tag} has a size that is not positive"


def test_a_range_of_immense_angles_is_none(tmp_path: Path) -> None:
    """As of joints that turn without end, for which exporters write 1e16."""
    root = ET.fromstring(Humanoid().urdf())
    limit = root.find("joint[@name='left_wrist']/limit")
    assert limit is not None
    limit.attrib.update(lower="-1e16", upper="1e+16")
    plain, assumed = rebuilt(ET.tostring(root, encoding="unicode"), tmp_path)
    limit = plain.find("joint[@name='left_wrist']/limit")
    assert limit is not None
    assert float(limit.attrib["upper"]) == pytest.approx(-float(limit.attrib["lower"]))
    assert "joint left_wrist: range" in assumed


def test_a_link_drawn_in_another_format_has_no_shape(tmp_path: Path) -> None:
    """Its drawn mesh would collide if it could be read; a missing mesh of a readable format is a fault as before."""
    root = ET.fromstring(with_shape("left_wrist_link", "visual", "mesh", filename="package://small/hand.gltf"))
    link = root.find("link[@name='left_wrist_link']")
    assert link is not None
    for shape in (link.find("visual"), link.find("collision")):
        assert shape is not None
        link.remove(shape)
    plain, assumed = rebuilt(ET.tostring(root, encoding="unicode"), tmp_path)
    assert plain.find("link[@name='left_wrist_link']/collision") is None
    assert assumed["link left_wrist_link: collision"] == "not its drawn mesh, which is none of .stl, .obj, .dae"
    mesh = link.find("visual/geometry/mesh")
    assert mesh is not None
    mesh.set("filename", "package://small/hand.stl")
    (tmp_path / "again").mkdir()
    with pytest.raises(InvalidInput, match="the zip has no such mesh"):
        rebuilt(ET.tostring(root, encoding="unicode"), tmp_path / "again")


@pytest.mark.parametrize(("factor", "is_replaced"), [(1000.0, True), (3.0, False)])
def test_moments_that_no_body_of_the_size_has_are_replaced(factor: float, is_replaced: bool, tmp_path: Path) -> None:
    """As of files in kg mm2 or g m2: an arm of 0.8 kg and 0.1 m with 1000 times its moments."""
    root = ET.fromstring(Humanoid().urdf())
    for name in ("left_elbow_link", "left_wrist_link"):
        inertia = root.find(f"link[@name='{name}']/inertial/inertia")
        assert inertia is not None
        inertia.attrib.update({key: str(factor * float(value)) for key, value in inertia.attrib.items()})
    link = root.find("link[@name='left_wrist_link']")
    assert link is not None
    for shape in (*link.findall("visual"), *link.findall("collision")):
        link.remove(shape)
    plain, assumed = rebuilt(ET.tostring(root, encoding="unicode"), tmp_path)
    inertia = plain.find("link[@name='left_elbow_link']/inertial/inertia")
    assert inertia is not None
    radius_m = (0.75 * 0.8 / (np.pi * 1000.0)) ** (1.0 / 3.0)
    if is_replaced:
        assert float(inertia.attrib["ixx"]) == pytest.approx(0.4 * 0.8 * radius_m**2, rel=1e-3)
        assert {key for key in assumed if key.endswith("inertia")} == {
            "link left_elbow_link: inertia",
            "link left_wrist_link: inertia",
        }
    else:
        assert not assumed


@pytest.mark.parametrize(("upper", "is_stated"), [(1.2, True), (7.0, False)])
def test_a_continuous_joint_with_a_range_has_that_range(upper: float, is_stated: bool, tmp_path: Path) -> None:
    root = ET.fromstring(Humanoid().urdf())
    joint = root.find("joint[@name='left_knee']")
    assert joint is not None
    joint.set("type", "continuous")
    limit = joint.find("limit")
    assert limit is not None
    limit.attrib.update(lower="0.1", upper=str(upper))
    plain, assumed = rebuilt(ET.tostring(root, encoding="unicode"), tmp_path)
    limit = plain.find("joint[@name='left_knee']/limit")
    assert limit is not None
    assert (float(limit.attrib["upper"]) == upper) == is_stated
    assert ("joint left_knee: type" in assumed) == is_stated == ("joint left_knee: range" not in assumed)


def test_names_may_have_combining_marks_and_spaces(tmp_path: Path) -> None:
    _, assumed = rebuilt(Humanoid(sides=("बायाँ 1", "दायाँ 1")).urdf(), tmp_path)
    proposal = propose_card("small", "small", tmp_path / "robots", assumed)
    assert proposal.robot.group["दायाँ 1_knee"] == "leg"
    assert parse_card("small", card_toml(proposal.card).encode()) == proposal.card


@pytest.mark.parametrize("side", ["🦵 left", "<b>left</b>", "left|right", 'a"b'])
def test_names_with_markup_or_signs_are_refused_with_what_is_allowed(side: str, tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match="letters, digits, spaces") as refusal:
        rebuilt(Humanoid(sides=(side, "other")).urdf(), tmp_path)
    assert all(fault.where.startswith(("link", "joint")) for fault in refusal.value.faults)


def test_a_joint_that_follows_another_is_opened_with_a_remark(tmp_path: Path) -> None:
    """As in parallel linkages of URDF files, which know no closed loops."""
    root = ET.fromstring(Humanoid().urdf())
    joint = root.find("joint[@name='left_ankle_pitch']")
    assert joint is not None
    ET.SubElement(joint, "mimic", joint="left_knee", multiplier="-1")
    plain, assumed = rebuilt(ET.tostring(root, encoding="unicode"), tmp_path)
    assert assumed["joint left_ankle_pitch: mimic"] == "not coupled to left_knee: it has a motor of its own here"
    assert plain.find("joint[@name='left_ankle_pitch']/mimic") is None


def collada(stl: bytes, up_axis: str, R: np.ndarray) -> bytes:
    """A mesh of a binary STL as COLLADA, its points turned by ``R``."""
    record = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    points = np.frombuffer(stl, record, offset=84)["corners"].reshape(-1, 3) @ R.T
    n = len(points)
    return (
        '<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">'
        f"<asset><up_axis>{up_axis}</up_axis></asset><library_geometries><geometry id='g'><mesh><source id='p'>"
        f"<float_array id='a' count='{3 * n}'>{' '.join(f'{float(v):.6f}' for v in points.ravel())}</float_array>"
        f"<technique_common><accessor source='#a' count='{n}' stride='3'><param name='X' type='float'/>"
        "<param name='Y' type='float'/><param name='Z' type='float'/></accessor></technique_common></source>"
        "<vertices id='v'><input semantic='POSITION' source='#p'/></vertices>"
        f"<triangles count='{n // 3}'><input semantic='VERTEX' source='#v' offset='0'/>"
        f"<p>{' '.join(map(str, range(n)))}</p></triangles></mesh></geometry></library_geometries>"
        "<library_visual_scenes><visual_scene id='s'><node id='n'><instance_geometry url='#g'/></node></visual_scene>"
        "</library_visual_scenes><scene><instance_visual_scene url='#s'/></scene></COLLADA>"
    ).encode()


@pytest.mark.parametrize(
    ("up_axis", "is_written_y_up", "is_turned"),
    [("Y_UP", True, True), ("Y_UP", False, False), ("Z_UP", False, False)],
)
def test_meshes_with_y_up_are_turned_where_they_fit_their_links(
    up_axis: str, is_written_y_up: bool, is_turned: bool, tmp_path: Path
) -> None:
    """Descriptions are written for programs that apply the up axis of COLLADA files, or for those that ignore it."""
    at = (SOLE_AHEAD_M, 0.0, 0.02 - SOLE_DROP_M)
    R = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]]) if is_written_y_up else np.eye(3)
    root = ET.fromstring(Humanoid(mesh_feet="package://small/sole.dae").urdf())
    for side in ("left", "right"):
        origin = root.find(f"link[@name='{side}_ankle_roll_link']/collision/origin")
        assert origin is not None
        origin.set("xyz", "0 0 0")
    mesh = collada(box_stl((*HALF_SOLE_M, 0.02), at), up_axis, R)
    _, assumed = rebuilt(ET.tostring(root, encoding="unicode"), tmp_path, {"small/sole.dae": mesh})
    assert ("meshes with y up" in assumed) == is_turned
    sole = propose_card("small", "small", tmp_path / "robots", assumed).card.effectors["left_foot"]
    assert sole.contact_half_size_m == pytest.approx(HALF_SOLE_M, abs=0.003)
    assert sole.position_m == pytest.approx((SOLE_AHEAD_M, 0.0, -SOLE_DROP_M), abs=1e-4)


@pytest.mark.parametrize(("gap_m", "turned_rad"), [(0.003, 0.05), (0.008, 0.0)])
def test_a_torso_that_rests_close_to_the_legs_is_turned(gap_m: float, turned_rad: float, tmp_path: Path) -> None:
    """A bar of the torso behind the hips: certificates ask for 5 mm between links."""
    root = ET.fromstring(Humanoid().urdf())
    axis, torso = root.find("joint[@name='waist']/axis"), root.find("link[@name='torso']")
    assert axis is not None
    assert torso is not None
    axis.set("xyz", "0 1 0")
    bar = ET.SubElement(torso, "collision")
    ET.SubElement(bar, "origin", xyz=f"{-0.04 - gap_m} 0 -0.15", rpy="0 0 0")
    ET.SubElement(ET.SubElement(bar, "geometry"), "box", size="0.02 0.3 0.02")
    _, assumed = rebuilt(ET.tostring(root, encoding="unicode"), tmp_path)
    card = propose_card("small", "small", tmp_path / "robots", assumed).card
    assert card.reference.joints_rad["waist"] == pytest.approx(turned_rad)
