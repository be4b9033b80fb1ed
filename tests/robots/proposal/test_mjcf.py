"""MJCF descriptions: the converted links move as the bodies of MuJoCo's own model, and what cannot be converted."""

import xml.etree.ElementTree as ET
from pathlib import Path, PurePosixPath

import mujoco
import numpy as np
import pinocchio as pin
import pytest

from stridelab.errors import InvalidInput, StridelabError, UnreadableFile
from stridelab.robots.proposal.archive import UnpackedRobot
from stridelab.robots.proposal.description import read_xml
from stridelab.robots.proposal.meshes import MeshConverter, binary_stl
from stridelab.robots.proposal.mjcf import urdf_of_mjcf
from stridelab.robots.proposal.propose import propose_card, rebuild_description
from support.robots.humanoid import HALF_SOLE_M, SOLE_AHEAD_M, SOLE_DROP_M, Humanoid, archive, box_stl

ODD = """
<mujoco>
  <compiler angle="degree" meshdir="assets" autolimits="true"/>
  <default>
    <joint damping="1" range="-40 50"/>
    <default class="shin"><geom type="capsule" size="0.04 0.1"/></default>
  </default>
  <asset><mesh name="block" file="block.stl" scale="0.5 1 1"/><material name="red" rgba="1 0 0 1"/></asset>
  <worldbody>
    <light pos="0 0 3"/>
    <geom name="floor" type="plane" size="1 1 .1"/>
    <body name="crate" pos="2 0 0"><freejoint/><geom type="box" size=".1 .1 .1" mass="1"/></body>
    <body name="base" pos="0 0 1" euler="0 0 30">
      <freejoint/>
      <geom type="ellipsoid" size=".1 .2 .1" mass="7"/>
      <body name="thigh" pos="0.1 -0.2 -0.1" euler="10 20 30">
        <joint name="hip" axis="1 1 0" pos="0.01 -0.02 0.03" ref="15" actuatorfrcrange="-60 80"/>
        <geom type="mesh" mesh="block" mass="3" pos="0.02 0 -0.1" axisangle="0 1 0 25" material="red"/>
        <geom type="sphere" size=".05" contype="0" conaffinity="0" mass="0.5"/>
        <body name="shin" pos="0 0 -0.4" zaxis="0.1 0 1">
          <joint name="knee" axis="0 1 0" pos="0 0 0.05" limited="false"/>
          <geom class="shin" mass="2"/>
          <body name="foot" pos="0 0 -0.3"><geom type="cylinder" size=".05 .02" mass="1"/></body>
        </body>
      </body>
    </body>
  </worldbody>
  <equality><connect body1="foot" body2="base" anchor="0 0 0"/></equality>
  <actuator><motor joint="knee" gear="5" ctrlrange="-10 12"/></actuator>
</mujoco>
"""


def upload_of(text: str, folder: Path, meshes: dict[str, bytes]) -> UnpackedRobot:
    """An unpacked robot with the description ``text``."""
    (folder / "robot.xml").write_text(text)
    paths = {}
    for name, content in meshes.items():
        paths[PurePosixPath(name)] = folder / name.replace("/", "-")
        paths[PurePosixPath(name)].write_bytes(content)
    return UnpackedRobot(folder / "robot.xml", PurePosixPath("robot.xml"), paths)


def converted(text: str, folder: Path, meshes: dict[str, bytes]) -> tuple[ET.Element, dict[str, str]]:
    upload = upload_of(text, folder, meshes)
    (folder / "made").mkdir()
    root, _, changed = urdf_of_mjcf(read_xml(upload.description, "robot.xml"), upload, folder / "made")
    return root, changed


def without_shapes(root: ET.Element) -> str:
    for link in root.iter("link"):
        for shape in [*link.findall("visual"), *link.findall("collision")]:
            link.remove(shape)
    return ET.tostring(root, encoding="unicode")


def compared_inertia(
    ours: pin.Model, q: np.ndarray, theirs: mujoco.MjModel, data: mujoco.MjData, body: str
) -> np.ndarray:
    """Inertia matrix of MuJoCo, after CoM and the place of ``body`` were compared in the frame of the base."""
    base, state = theirs.body("base").id, ours.createData()
    mujoco.mj_kinematics(theirs, data)
    mujoco.mj_comPos(theirs, data)
    R, p_m = data.xmat[base].reshape(3, 3), data.xpos[base]
    com_m = pin.centerOfMass(ours, state, q)
    np.testing.assert_allclose(com_m, R.T @ (data.subtree_com[base] - p_m), atol=1e-12)
    pin.framesForwardKinematics(ours, state, q)
    at, there = state.oMf[ours.getFrameId(body)], theirs.body(body).id
    np.testing.assert_allclose(at.translation, R.T @ (data.xpos[there] - p_m), atol=1e-12)
    np.testing.assert_allclose(at.rotation, R.T @ data.xmat[there].reshape(3, 3), atol=1e-12)
    mujoco.mj_crb(theirs, data)
    full = np.zeros((theirs.nv, theirs.nv))
    mujoco.mj_fullM(theirs, data, full)
    return full


def test_links_and_masses_move_as_the_bodies_of_mujoco(tmp_path: Path) -> None:
    block = box_stl((0.1, 0.05, 0.2), (0.02, 0.03, 0.0))
    root, changed = converted(ODD, tmp_path, {"assets/block.stl": block})
    assert changed == {
        "body crate": "not a part of the robot, left out",
        "equality 0": "a closed loop, opened here",
    }
    theirs = mujoco.MjModel.from_xml_string(ODD.replace('meshdir="assets"', ""), {"block.stl": block})
    data = mujoco.MjData(theirs)
    joints = {joint.get("name"): joint for joint in root.iter("joint")}
    limits = {name: joint.find("limit") for name, joint in joints.items()}
    assert limits["foot_fixed"] is None
    hip, knee = limits["hip"], limits["knee"]
    assert hip is not None
    assert knee is not None
    assert [float(hip.attrib[key]) for key in ("lower", "upper")] == pytest.approx(np.radians([-55.0, 35.0]))
    assert float(hip.attrib["effort"]) == 80.0
    assert [float(knee.attrib[key]) for key in ("lower", "upper", "effort")] == [0.0, 0.0, 60.0]
    assert {name: joint.find("dynamics") is not None for name, joint in joints.items()} == {
        "hip": True,
        "knee": True,
        "foot_fixed": False,
    }
    colors = [color.get("rgba") for color in root.iter("color")]
    assert colors

    ours = pin.buildModelFromXML(without_shapes(root), pin.JointModelFreeFlyer())
    state, rng = ours.createData(), np.random.default_rng(5)
    base = theirs.body("base").id
    assert pin.computeTotalMass(ours) == pytest.approx(theirs.body_subtreemass[base], rel=1e-12)
    for _ in range(5):
        q = pin.neutral(ours)
        for name in ("hip", "knee"):
            angle_rad = rng.uniform(-1.0, 1.0)
            at = theirs.joint(name).qposadr[0]
            data.qpos[at] = theirs.qpos0[at] + angle_rad
            q[ours.joints[ours.getJointId(name)].idx_q] = angle_rad
        full = compared_inertia(ours, q, theirs, data, "foot")
        at = [theirs.joint(name).dofadr[0] for name in ("hip", "knee")]
        inertia = pin.crba(ours, state, q)
        np.testing.assert_allclose(np.triu(inertia)[6:, 6:], np.triu(full[np.ix_(at, at)]), atol=1e-12)


def test_the_shapes_are_where_mujoco_has_them(tmp_path: Path) -> None:
    root, _ = converted(ODD, tmp_path, {"assets/block.stl": box_stl((0.1, 0.05, 0.2), (0.02, 0.03, 0.0))})
    thigh = next(link for link in root.iter("link") if link.get("name") == "thigh")
    assert len(thigh.findall("visual")) == 2
    (collision,) = thigh.findall("collision")
    mesh, origin = collision.find("geometry/mesh"), collision.find("origin")
    assert mesh is not None
    assert origin is not None
    record = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    content = (tmp_path / "made" / mesh.attrib["filename"]).read_bytes()
    corners = np.frombuffer(content, record, offset=84)["corners"].reshape(-1, 3)
    R = pin.rpy.rpyToMatrix(np.array([float(value) for value in origin.attrib["rpy"].split()]))
    placed = corners @ R.T + [float(value) for value in origin.attrib["xyz"].split()]
    block = np.array([(x, y, z) for x in (-0.08, 0.12) for y in (-0.02, 0.08) for z in (-0.2, 0.2)])
    block *= (0.5, 1.0, 1.0)
    a = np.radians(25.0)
    turn = np.array([[np.cos(a), 0.0, np.sin(a)], [0.0, 1.0, 0.0], [-np.sin(a), 0.0, np.cos(a)]])
    expected = block @ turn.T + (0.02, 0.0, -0.1) - np.array([0.01, -0.02, 0.03])
    for corner in expected:
        assert np.linalg.norm(placed - corner, axis=1).min() < 1e-6
    shin = next(link for link in root.iter("link") if link.get("name") == "shin")
    forms = [form.tag for element in shin.findall("collision") for form in element.iterfind("geometry/*")]
    assert sorted(forms) == ["cylinder", "sphere", "sphere"]


def volume_and_middle(content: bytes) -> tuple[float, np.ndarray]:
    """Signed volume (m3) of a binary STL, positive if its triangles face outwards, and the centre of its volume."""
    record = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    corners = np.frombuffer(content, record, offset=84)["corners"].astype(float)
    parts = np.linalg.det(corners) / 6.0
    return float(parts.sum()), parts @ corners.sum(axis=1) / 4.0 / parts.sum()


@pytest.mark.parametrize("scale", [(-0.5, 1.0, 1.0), (-0.5, -1.0, -1.0), (-0.5, 1.0, -1.0)])
def test_left_handed_meshes_keep_their_outside(scale: tuple[float, float, float], tmp_path: Path) -> None:
    """A mirrored mesh is where its scale puts it, in both formats, and its triangles face outwards."""
    block = box_stl((0.1, 0.05, 0.2), (0.02, 0.03, 0.01))
    words = " ".join(str(number) for number in scale)
    root, _ = converted(ODD.replace('scale="0.5 1 1"', f'scale="{words}"'), tmp_path, {"assets/block.stl": block})
    thigh = next(link for link in root.iter("link") if link.get("name") == "thigh")
    mesh, origin = thigh.find("collision/geometry/mesh"), thigh.find("collision/origin")
    assert mesh is not None
    assert origin is not None
    contents = [(tmp_path / "made" / mesh.attrib["filename"]).read_bytes()]
    converter = MeshConverter(
        UnpackedRobot(tmp_path, PurePosixPath("r"), {PurePosixPath("b.stl"): tmp_path / "b.stl"}), tmp_path, "p"
    )
    (tmp_path / "b.stl").write_bytes(block)
    for is_collision in (True, False):
        name = converter.convert("b.stl", scale, is_collision)
        assert name is not None
        contents.append((tmp_path / PurePosixPath(name).name).read_bytes())
    for content in contents:
        volume_m3, middle_m = volume_and_middle(content)
        assert volume_m3 == pytest.approx(0.5 * 0.2 * 0.1 * 0.4, rel=1e-5)
        if content is contents[0]:  # MuJoCo moves the origin of a mesh; its geom is at a place of its own
            R = pin.rpy.rpyToMatrix(np.array([float(value) for value in origin.attrib["rpy"].split()]))
            in_thigh_m = R @ middle_m + [float(value) for value in origin.attrib["xyz"].split()]
            turn = pin.rpy.rpyToMatrix(0.0, np.radians(25.0), 0.0)
            middle_m = turn.T @ (in_thigh_m - (0.02, 0.0, -0.1) + np.array([0.01, -0.02, 0.03]))
        assert middle_m == pytest.approx(np.multiply(scale, (0.02, 0.03, 0.01)), abs=1e-6)


def test_a_mesh_of_many_shells_is_displayed_with_few_triangles(tmp_path: Path) -> None:
    """Triangles that share no vertices, since they differ in the last digits: collapses of edges tear them apart."""
    turn, rise = np.meshgrid(np.linspace(0.0, 2.0 * np.pi, 121), np.linspace(0.0, np.pi, 61), indexing="ij")
    sphere_m = 0.1 * np.stack([np.sin(rise) * np.cos(turn), np.sin(rise) * np.sin(turn), np.cos(rise)], axis=-1)
    sphere_m = np.round(sphere_m, 3)
    a, b, c, d = sphere_m[:-1, :-1], sphere_m[1:, :-1], sphere_m[1:, 1:], sphere_m[:-1, 1:]
    triangles = np.concatenate([np.stack(three, axis=2).reshape(-1, 3, 3) for three in ((a, c, b), (a, d, c))])
    triangles += np.random.default_rng(3).normal(0.0, 2e-5, triangles.shape)
    points = triangles.reshape(-1, 3)
    (tmp_path / "b.stl").write_bytes(binary_stl(points, np.arange(len(points)).reshape(-1, 3)))
    upload = UnpackedRobot(tmp_path, PurePosixPath("r"), {PurePosixPath("b.stl"): tmp_path / "b.stl"})
    name = MeshConverter(upload, tmp_path, "p").convert("b.stl", (1.0, 1.0, 1.0), False)
    assert name is not None
    content = (tmp_path / PurePosixPath(name).name).read_bytes()
    assert len(triangles) > 14_000
    assert int.from_bytes(content[80:84], "little") <= 6_000
    volume_m3, middle_m = volume_and_middle(content)
    assert volume_m3 == pytest.approx(4.0 / 3.0 * np.pi * 1e-3, rel=0.02)
    assert middle_m == pytest.approx(np.zeros(3), abs=1e-3)


@pytest.mark.parametrize(
    "base", ["<joint type='slide' axis='1 0 0' pos='1 0 0'/><joint type='ball'/>", "<freejoint/>", ""]
)
def test_the_joints_of_a_body_on_the_world_are_its_floating_base(base: str, tmp_path: Path) -> None:
    text = f"<mujoco><worldbody><body name='base'>{base}{BOX}</body></worldbody>"
    text += "<contact><pair geom1='ground' geom2='sole'/></contact></mujoco>"
    root, _ = converted(text, tmp_path, {})
    assert [link.get("name") for link in root.iter("link")] == ["base"]
    assert not list(root.iter("joint"))
    assert {origin.attrib["xyz"] for origin in root.iter("origin")} == {"0.0 0.0 0.0"}


BOX = "<geom type='box' size='.1 .1 .1'/>"


def test_one_humanoid_has_one_card_in_both_formats(tmp_path: Path) -> None:
    cards = []
    for kind, text in (("urdf", Humanoid().urdf()), ("xml", Humanoid().mjcf())):
        folder = tmp_path / kind
        folder.mkdir()
        (folder / "upload").write_bytes(archive({f"small/small.{kind}": text, "small/scene_flat.xml": "<mujoco/>"}))
        assumed = rebuild_description(folder / "upload", "small.zip", "small", folder / "robots")
        cards.append(propose_card("small", "small", folder / "robots", assumed).card)
    ours, theirs = cards
    assert theirs.groups == ours.groups
    for joint, range_rad in ours.limits.position_rad.items():
        assert theirs.limits.position_rad[joint] == pytest.approx(range_rad)
    assert theirs.limits.torque_nm == pytest.approx(ours.limits.torque_nm)
    assert theirs.reference.joints_rad == pytest.approx(ours.reference.joints_rad, abs=2e-3)
    for side in ("left", "right"):
        foot = theirs.effectors[f"{side}_foot"]
        assert foot.position_m == pytest.approx((SOLE_AHEAD_M, 0.0, -SOLE_DROP_M), abs=1e-4)
        assert foot.contact_half_size_m == pytest.approx(HALF_SOLE_M, abs=0.003)


def test_stated_rotor_inertias_are_taken_over(tmp_path: Path) -> None:
    text = Humanoid().mjcf().replace('<joint name="left_knee"', '<joint armature="0.037" name="left_knee"')
    assert "0.037" in text
    (tmp_path / "upload").write_bytes(archive({"small.xml": text}))
    assumed = rebuild_description(tmp_path / "upload", "small.zip", "small", tmp_path / "robots")
    proposal = propose_card("small", "small", tmp_path / "robots", assumed)
    rotors = proposal.card.rotors.armature_kg_m2
    assert rotors["left_knee"] == 0.037
    assert rotors["right_knee"] != 0.037
    assert "left_knee" not in proposal.assumed["rotors.armature_kg_m2"]


BODY = f"<mujoco><worldbody><body name='a'>{BOX}<body name='b'>{{}}{BOX}</body></body></worldbody></mujoco>"
REFUSED = {
    "a broken model": (
        "<mujoco><worldbody><body><geom type='cube'/></body></worldbody></mujoco>",
        "robot-data-unreadable",
    ),
    "included files": ("<mujoco><include file='/etc/passwd'/></mujoco>", "robot-data-unreadable"),
    "a missing mesh": (
        "<mujoco><asset><mesh file='gone.stl'/></asset></mujoco>",
        "robot-description-invalid",
    ),
    "a mesh outside": (
        "<mujoco><asset><mesh name='p' file='../../etc/passwd'/></asset></mujoco>",
        "robot-description-invalid",
    ),
    "an included file that includes itself": (
        "<mujoco><include file='robot.xml'/></mujoco>",
        "robot-data-unreadable",
    ),
    "four joints": (
        BODY.format("<joint axis='1 0 0'/><joint axis='0 1 0'/><joint axis='1 0 0' pos='0 0 1'/><joint axis='0 0 1'/>"),
        "robot-description-invalid",
    ),
    "a ball": (
        BODY.format("<joint type='ball'/>"),
        "robot-description-invalid",
    ),
    "no body": ("<mujoco><worldbody/></mujoco>", "robot-description-invalid"),
    "a plugin": (
        "<mujoco><extension><plugin plugin='evil'/></extension><worldbody/></mujoco>",
        "robot-description-invalid",
    ),
}


HIP = """
<mujoco>
  <worldbody>
    <body name="base">
      <freejoint/>
      <geom type="box" size=".1 .2 .1" mass="7"/>
      <body name="thigh" pos="0.1 -0.2 -0.1" euler="10 20 30">
        <joint name="yaw" axis="0 0 1" pos="0.01 0 0.03"/>
        <joint name="roll" axis="1 0 0" pos="0 0.01 -0.01"/>
        <joint axis="0 1 0" pos="0 0.01 -0.01" range="-30 60"/>
        <geom type="capsule" size=".05 .2" pos="0.01 0.02 -0.2" euler="5 10 0" mass="4"/>
        <body name="shin" pos="0 0 -0.4">
          <joint name="knee" axis="0 1 0"/>
          <geom type="box" size=".05 .04 .2" mass="2"/>
        </body>
      </body>
    </body>
  </worldbody>
</mujoco>
"""


def test_several_joints_of_one_body_move_it_as_in_mujoco(tmp_path: Path) -> None:
    root, changed = converted(HIP, tmp_path, {})
    assert changed == {"body thigh": "it has 3 joints; each got a link, all but the last with 1 % of its mass"}
    theirs = mujoco.MjModel.from_xml_string(HIP)
    data, names = mujoco.MjData(theirs), ["yaw", "roll", "thigh_joint_3", "knee"]
    ours = pin.buildModelFromXML(without_shapes(root), pin.JointModelFreeFlyer())
    assert list(ours.names)[2:] == names
    state, rng = ours.createData(), np.random.default_rng(8)
    for _ in range(5):
        angles_rad = rng.uniform(-1.0, 1.0, 4)
        data.qpos[7:] = angles_rad
        q = np.concatenate([pin.neutral(ours)[:7], angles_rad])
        full = compared_inertia(ours, q, theirs, data, "shin")
        inertia = np.triu(pin.crba(ours, state, q))[6:, 6:]
        # the spheres do not turn with the thigh: 2e-5 kg m2 of water against 0.1 of the leg
        np.testing.assert_allclose(inertia, np.triu(full[6:, 6:]), atol=3e-5)


def test_a_description_is_read_with_the_files_that_it_includes(tmp_path: Path) -> None:
    for folder, cut in ((tmp_path / "one", False), (tmp_path / "parts", True)):
        folder.mkdir()
        text = Humanoid().mjcf()
        files = {"small/small.xml": text}
        if cut:
            start, end = text.index("<body"), text.rindex("</worldbody>")
            files["small/parts/trunk.xml"] = f"<mujocoinclude>{text[start:end]}</mujocoinclude>"
            files["small/small.xml"] = f"{text[:start]}<include file='parts/trunk.xml'/>{text[end:]}"
            files["small/scene.xml"] = "<mujoco><include file='small.xml'/></mujoco>"
        (folder / "upload").write_bytes(archive(files))
        rebuild_description(folder / "upload", "small.zip", "small", folder / "robots")
    one, parts = ((tmp_path / case / "robots" / "small" / "robot.urdf").read_text() for case in ("one", "parts"))
    assert one == parts
    assert "<link" in one


@pytest.mark.parametrize("case", REFUSED)
def test_unsupported_elements_are_refused_by_name(case: str, tmp_path: Path) -> None:
    text, code = REFUSED[case]
    (tmp_path / "upload").write_bytes(archive({"robot.xml": text}))
    with pytest.raises(StridelabError) as refused:
        rebuild_description(tmp_path / "upload", "robot.zip", "small", tmp_path / "robots")
    assert refused.value.code == code
    assert isinstance(refused.value, InvalidInput | UnreadableFile)
    assert refused.value.faults


def test_models_elsewhere_on_the_disk_are_not_read(tmp_path: Path) -> None:
    other = tmp_path / "other.xml"
    other.write_text(
        "<mujoco><worldbody><body name='b'><geom size='.1'/></body></worldbody></mujoco>", encoding="utf-8"
    )
    start, _, end = Humanoid().mjcf().partition("<worldbody>")
    text = f"{start}<asset><model name='m' file='{other}'/></asset><worldbody>{end}"
    at = text.rindex("</body>")
    text = f"{text[:at]}<attach model='m' body='b' prefix='x_'/>{text[at:]}"
    (tmp_path / "upload").write_bytes(archive({"robot.xml": text}))
    with pytest.raises(InvalidInput, match="it reads another model") as refused:
        rebuild_description(tmp_path / "upload", "robot.zip", "small", tmp_path / "robots")
    assert [fault.where for fault in refused.value.faults] == ["<attach>", "<model>"]
