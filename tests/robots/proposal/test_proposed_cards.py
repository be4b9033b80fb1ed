"""Proposed cards: effectors, axes, limits and posture of humanoids made here, and what is not a humanoid."""

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from stridelab.errors import InvalidInput, UnreadableFile
from stridelab.robots.assembly import effector_of
from stridelab.robots.proposal.collision_table import never_colliding
from stridelab.robots.proposal.propose import Proposal, propose_card, rebuild_description
from stridelab.robots.self_collision import SelfCollision
from support.robots.humanoid import HALF_SOLE_M, SOLE_AHEAD_M, SOLE_DROP_M, Humanoid, archive, box_stl

TURNED = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
"""The axes of the turned root link, as its columns: they point to the right, down and ahead."""


def proposal_of(humanoid: Humanoid, folder: Path, files: dict[str, bytes] | None = None) -> Proposal:
    return proposal_of_text(humanoid.urdf(), folder, files)


def proposal_of_text(urdf: str, folder: Path, files: dict[str, bytes] | None = None) -> Proposal:
    upload = folder / "upload"
    upload.write_bytes(archive({"small/urdf/small.urdf": urdf, **(files or {})}))
    assumed = rebuild_description(upload, "small.zip", "small", folder / "robots")
    return propose_card("small", "small", folder / "robots", assumed)


@pytest.fixture(scope="module")
def usual(tmp_path_factory: pytest.TempPathFactory) -> Proposal:
    return proposal_of(Humanoid(), tmp_path_factory.mktemp("usual"))


def test_soles_are_the_rectangles_of_the_feet(usual: Proposal) -> None:
    for side in ("left", "right"):
        foot = usual.card.effectors[f"{side}_foot"]
        assert foot.frame == f"{side}_ankle_roll_link"
        assert foot.position_m == pytest.approx((SOLE_AHEAD_M, 0.0, -SOLE_DROP_M), abs=1e-4)
        assert foot.contact_half_size_m == pytest.approx(HALF_SOLE_M, abs=0.003)
        assert foot.contact_half_size_m is not None
        assert foot.contact_half_size_m[0] <= HALF_SOLE_M[0]
        assert foot.ankle == (f"{side}_ankle_pitch", f"{side}_ankle_roll")


def test_the_reference_posture_is_upright_on_level_soles_with_bent_knees(usual: Proposal) -> None:
    robot = usual.robot
    data = robot.model.createData()
    pin.framesForwardKinematics(robot.model, data, robot.q_reference)
    for name in ("left_foot", "right_foot"):
        effector = robot.effectors[name]
        T = data.oMf[robot.model.getFrameId(effector.frame)]
        assert (T.rotation @ effector.T_frame_contact.rotation)[:, 2] == pytest.approx((0.0, 0.0, 1.0), abs=1e-2)
        assert T.act(effector.T_frame_contact.position_m)[2] == pytest.approx(0.0, abs=2e-3)
    knees = [robot.q_reference[7 + robot.joint_names.index(f"{side}_knee")] for side in ("left", "right")]
    assert knees[0] == pytest.approx(knees[1], abs=0.02)
    assert 0.5 < knees[0] < 1.0
    com = pin.centerOfMass(robot.model, data, robot.q_reference)
    assert abs(com[0]) < 0.02
    assert abs(com[1]) < 0.01
    assert not SelfCollision.for_robot(robot).colliding_links(robot.q_reference)


def test_hands_are_at_the_ends_of_the_arms(usual: Proposal) -> None:
    assert {name for name, e in usual.card.effectors.items() if e.kind == "point"} == {"left_hand", "right_hand"}
    left = usual.card.effectors["left_hand"]
    assert left.frame == "left_wrist_link"
    assert left.position_m[2] == pytest.approx(-0.068, abs=1e-3)  # the lower end of the box
    assert effector_of("left_hand", left).T_frame_contact.rotation[:, 2] == pytest.approx((0.0, 0.0, 1.0))


def test_arms_are_clear_of_the_body_at_rest(tmp_path: Path) -> None:
    """A body as wide as the arms hang: at the first place that is tried they are 1 cm from it."""
    root = ET.fromstring(Humanoid().urdf())
    pelvis = root.find("link[@name='pelvis']")
    assert pelvis is not None
    plate = ET.SubElement(ET.SubElement(ET.SubElement(pelvis, "collision"), "geometry"), "box")
    plate.set("size", "0.05 0.4 0.6")
    robot = proposal_of_text(ET.tostring(root, encoding="unicode"), tmp_path).robot
    assert len(SelfCollision.for_robot(robot).colliding_links(robot.q_reference)) == 0
    nearest = SelfCollision.for_robot(robot, margin_m=0.02).colliding_links(robot.q_reference)
    assert not any("shoulder" in link or "elbow" in link for pair in nearest for link in pair)


def test_every_joint_of_the_description_is_in_its_group(usual: Proposal) -> None:
    groups = usual.robot.group
    assert {groups[f"left_{joint}"] for joint in ("hip_yaw", "knee", "ankle_roll")} == {"leg"}
    assert {groups[f"right_{joint}"] for joint in ("shoulder_pitch", "elbow", "wrist")} == {"arm"}
    assert groups["waist"] == "torso"
    assert not [field for field in usual.assumed if field.startswith("limits.")]


def test_missing_limits_are_estimated_and_listed(tmp_path: Path) -> None:
    proposal = proposal_of(Humanoid(effort=None, velocity=0.0), tmp_path)
    assert "limits.torque_nm.left_knee" in proposal.assumed
    assert "limits.velocity_rad_s.waist" in proposal.assumed
    model = proposal.robot.model
    knee = proposal.robot.joint_names.index("left_knee")
    assert 50.0 < model.effortLimit[6 + knee] < 500.0
    assert 1.0 < model.velocityLimit[6 + knee] < 20.0


def test_the_root_link_may_have_any_axes(tmp_path: Path, usual: Proposal) -> None:
    turned = proposal_of(Humanoid(R_root=TURNED), tmp_path).robot
    com = [pin.centerOfMass(r.model, r.model.createData(), r.q_reference) for r in (usual.robot, turned)]
    assert com[1] == pytest.approx(com[0], abs=0.01)
    assert turned.R_root_trunk == pytest.approx(TURNED.T)


def test_toes_are_locked_and_the_sole_is_the_foot(tmp_path: Path) -> None:
    proposal = proposal_of(Humanoid(toes=True), tmp_path)
    assert set(proposal.card.locked_joints) == {"left_toe", "right_toe"}
    assert proposal.card.effectors["left_foot"].frame == "left_ankle_roll_link"


def test_names_may_be_in_other_alphabets(tmp_path: Path) -> None:
    proposal = proposal_of(Humanoid(sides=("лев ая", "прав.ая")), tmp_path)
    assert proposal.robot.group["прав.ая_knee"] == "leg"
    assert "left and right" in proposal.assumed


def test_one_of_several_descriptions_is_chosen_by_the_end_of_its_path(tmp_path: Path) -> None:
    """As in the archives of makers, which hold a robot with and without hands."""
    files = {"small/urdf/small.urdf": Humanoid().urdf(), "small/urdf/legs_only.urdf": Humanoid(arms=False).urdf()}
    (tmp_path / "upload").write_bytes(archive(files))
    robots = tmp_path / "robots"
    rebuild_description(tmp_path / "upload", "small.zip", "legs", robots, "urdf/legs_only.urdf")
    assert "elbow" not in (robots / "legs" / "robot.urdf").read_text()
    rebuild_description(tmp_path / "upload", "small.zip", "whole", robots, "small.urdf")
    assert "elbow" in (robots / "whole" / "robot.urdf").read_text()
    with pytest.raises(UnreadableFile) as refusal:
        rebuild_description(tmp_path / "upload", "small.zip", "third", robots, "hands.urdf")
    assert refusal.value.code == "robot-description-missing"
    assert sorted(fault.where for fault in refusal.value.faults) == sorted(files)


def test_soles_of_meshes_in_the_archive(tmp_path: Path) -> None:
    half = (*HALF_SOLE_M, 0.02)
    files = {"small/meshes/sole.STL": box_stl(half), "other/sole.stl": box_stl((1.0, 1.0, 1.0))}
    proposal = proposal_of(Humanoid(mesh_feet="package://any/small/meshes/sole.STL"), tmp_path, files)
    size = proposal.card.effectors["left_foot"].contact_half_size_m
    assert size == pytest.approx(HALF_SOLE_M, abs=0.003)
    assert sorted(path.name for path in (tmp_path / "robots").rglob("*.stl")) == ["mesh-0000.stl"]
    assert "wider than long" not in proposal.assumed["effectors.left_foot"]


def test_feet_across_are_remarked_on(tmp_path: Path) -> None:
    """As of meshes that are turned about the vertical."""
    x_m, y_m = HALF_SOLE_M
    files = {"small/meshes/sole.stl": box_stl((y_m, x_m, 0.02))}
    proposal = proposal_of(Humanoid(mesh_feet="package://any/small/meshes/sole.stl"), tmp_path, files)
    assert "wider than long" in proposal.assumed["effectors.left_foot"]


@pytest.mark.parametrize(
    ("humanoid", "code", "words"),
    [
        (Humanoid(foot="sphere"), "robot-not-humanoid", "point foot"),
        (Humanoid(foot="wheel"), "robot-not-humanoid", "wheel"),
        (Humanoid(legs=2), "robot-not-humanoid", "4 equal limbs"),
        (Humanoid(scale=1000.0), "robot-description-invalid", "millimetres"),
        (Humanoid(scale=20.0), "robot-description-invalid", "metres"),
        (Humanoid(mass_scale=1e-4), "robot-description-invalid", "mass"),
    ],
    ids=["point feet", "wheels", "four legs", "millimetres", "a giant", "3 g"],
)
def test_a_robot_that_is_no_humanoid_is_refused_with_the_reason(
    humanoid: Humanoid, code: str, words: str, tmp_path: Path
) -> None:
    with pytest.raises(InvalidInput, match=words) as refusal:
        proposal_of(humanoid, tmp_path)
    assert refusal.value.code == code
    assert refusal.value.faults


def test_a_joint_with_the_name_of_its_link_is_renamed(tmp_path: Path) -> None:
    urdf = Humanoid().urdf().replace('joint name="waist"', 'joint name="torso"')
    (tmp_path / "upload").write_bytes(archive({"small.urdf": urdf}))
    assumed = rebuild_description(tmp_path / "upload", "small.zip", "small", tmp_path / "robots")
    assert assumed["joint torso: name"] == "torso_joint, since a link has the same name"
    proposal = propose_card("small", "small", tmp_path / "robots", assumed)
    assert proposal.robot.group["torso_joint"] == "torso"


def test_spaces_at_the_ends_of_names_are_removed(tmp_path: Path) -> None:
    text = Humanoid().urdf().replace('name="left_knee"', 'name="left_knee "')
    text = text.replace('<link name="left_knee_link"', '<link name=" left_knee_link"')
    plain, assumed = rebuilt(text, tmp_path)
    assert plain.find("joint[@name='left_knee']/child[@link='left_knee_link']") is not None
    assert assumed.keys() == {"joint left_knee: name", "link left_knee_link: name"}


def test_a_joint_between_the_root_and_the_legs_is_locked(tmp_path: Path) -> None:
    # The torso becomes the root: the waist then turns the pelvis with both legs.
    urdf = Humanoid().urdf()
    waist = '<parent link="pelvis" /><child link="torso" />'
    assert waist in urdf
    proposal = proposal_of_text(urdf.replace(waist, '<parent link="torso" /><child link="pelvis" />'), tmp_path)
    assert proposal.card.locked_joints == ("waist",)
    assert set(proposal.card.effectors) == {"left_foot", "right_foot", "left_hand", "right_hand"}


def rebuilt(urdf: str, folder: Path) -> tuple[ET.Element, dict[str, str]]:
    """The rebuilt description of ``urdf``, and what was assumed."""
    (folder / "upload").write_bytes(archive({"small.urdf": urdf}))
    assumed = rebuild_description(folder / "upload", "small.zip", "small", folder / "robots")
    text = (folder / "robots" / "small" / "robot.urdf").read_bytes()
    return ET.fromstring(text), assumed


def with_inertia(name: str, mass_kg: float, moments_kg_m2: tuple[float, ...]) -> str:
    """The usual robot with the mass and the moments of inertia of one link replaced."""
    root = ET.fromstring(Humanoid().urdf())
    values = dict(zip(("ixx", "iyy", "izz"), moments_kg_m2, strict=True))
    for tag, numbers in (("mass", {"value": mass_kg}), ("inertia", values)):
        element = root.find(f"link[@name='{name}']/inertial/{tag}")
        assert element is not None
        element.attrib.update({key: repr(value) for key, value in numbers.items()})
    return ET.tostring(root, encoding="unicode")


def test_a_limit_that_is_none_is_missing(tmp_path: Path) -> None:
    """Descriptions give a joint without a limit a large number, or infinity; missing limits are 0 and estimated."""
    plain, _ = rebuilt(Humanoid(effort=1e9, velocity=float("inf")).urdf(), tmp_path)
    limits = [joint.attrib for joint in plain.iter("limit")]
    assert limits
    assert {(limit["effort"], limit["velocity"]) for limit in limits} == {("0.0", "0.0")}


def test_weak_legs_are_remarked_on(tmp_path: Path, usual: Proposal) -> None:
    assert "limits.torque_nm" not in usual.assumed
    weak = proposal_of(Humanoid(effort=40.0), tmp_path)
    assert "40 N m at most" in weak.assumed["limits.torque_nm"]
    knee = weak.robot.joint_names.index("left_knee")
    assert weak.robot.model.effortLimit[6 + knee] == 40.0


def test_estimated_torques_do_not_hide_weak_legs(tmp_path: Path) -> None:
    """As of a description that states the torques of its motors before their gears, but not of every joint."""
    root = ET.fromstring(Humanoid(effort=12.0).urdf())
    limit = root.find("joint[@name='left_knee']/limit")
    assert limit is not None
    limit.set("effort", "0")
    proposal = proposal_of_text(ET.tostring(root, encoding="unicode"), tmp_path)
    assert "limits.torque_nm.left_knee" in proposal.assumed
    assert "12 N m at most" in proposal.assumed["limits.torque_nm"]


def test_slow_legs_are_remarked_on(tmp_path: Path, usual: Proposal) -> None:
    assert "limits.velocity_rad_s" not in usual.assumed
    slow = proposal_of(Humanoid(velocity=0.5), tmp_path)
    assert "0.5 rad/s at most" in slow.assumed["limits.velocity_rad_s"]
    assert float(slow.robot.model.velocityLimit[6 + slow.robot.joint_names.index("left_knee")]) == 0.5


@pytest.mark.parametrize(
    ("stated", "expected"),
    [
        ((0.0, 0.0, 0.0), (2.57e-3, 2.57e-3, 2.57e-3)),
        ((4e-3, 4e-3, -1e-17), (6.57e-3, 6.57e-3, 2.57e-3)),
        ((0.0, 0.0, 5e-3), (2.57e-3, 2.57e-3, 2.57e-3)),
        ((4e-3, 5e-3, 6e-3), (4e-3, 5e-3, 6e-3)),
    ],
    ids=["a point", "a line", "contradictory", "a body"],
)
def test_missing_moments_of_inertia_are_those_of_a_sphere(
    stated: tuple[float, ...], expected: tuple[float, ...], tmp_path: Path
) -> None:
    """A sphere of water of 1.36 kg has a radius of 68.7 mm and 2/5 m r^2 = 2.57e-3 kg m2."""
    plain, assumed = rebuilt(with_inertia("left_elbow_link", 1.36, stated), tmp_path)
    inertia = plain.find("link[@name='left_elbow_link']/inertial/inertia")
    assert inertia is not None
    assert [float(inertia.attrib[key]) for key in ("ixx", "iyy", "izz")] == pytest.approx(expected, rel=2e-3)
    assert assumed.keys() == (set() if expected == stated else {"link left_elbow_link: inertia"})


def test_a_motor_that_is_added_to_the_moments_of_its_link_is_a_rotor(tmp_path: Path) -> None:
    """The knee turns about y, which is the x of the axes in which the inertia of its link is stated."""
    root = ET.fromstring(with_inertia("left_knee_link", 3.0, (0.41, 0.01, 0.02)))
    origin = root.find("link[@name='left_knee_link']/inertial/origin")
    assert origin is not None
    origin.set("rpy", f"0 0 {np.pi / 2}")
    proposal = proposal_of_text(ET.tostring(root, encoding="unicode"), tmp_path)
    model, v = proposal.robot.model, 6 + proposal.robot.joint_names.index("left_knee")
    assert model.armature[v] == pytest.approx(0.41 - 0.02)
    body = model.inertias[model.getJointId("left_knee")].inertia
    assert np.diag(body) == pytest.approx((0.01, 0.02, 0.02), abs=1e-6)
    assert proposal.assumed["joint left_knee: rotor inertia"].startswith("0.39 kg m2")


def test_moments_that_no_motor_explains_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match=r"left_knee_link: its principal moments of inertia .* are not physical"):
        proposal_of_text(with_inertia("left_knee_link", 3.0, (0.41, 0.01, 0.02)), tmp_path)


def test_a_negative_moment_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match="link left_elbow_link: its smallest principal moment") as refusal:
        proposal_of_text(with_inertia("left_elbow_link", 0.8, (-1e-3, 1e-3, 1e-3)), tmp_path)
    assert refusal.value.code == "robot-description-invalid"


@pytest.mark.parametrize("is_drawn", [True, False])
def test_hulls_of_neighbours_that_meet_where_the_meshes_do_not_are_not_checked(is_drawn: bool, tmp_path: Path) -> None:
    """A plate of the pelvis before the thighs, as the hull of a pelvis that is hollow there, or drawn as well."""
    root = ET.fromstring(Humanoid(arms=False).urdf())
    pelvis = root.find("link[@name='pelvis']")
    assert pelvis is not None
    for kind in ("collision", "visual") if is_drawn else ("collision",):
        plate = ET.SubElement(pelvis, kind)
        ET.SubElement(plate, "origin", xyz="0.22 0 -0.28")
        ET.SubElement(ET.SubElement(plate, "geometry"), "box", size="0.02 0.8 0.4")
    proposal = proposal_of_text(ET.tostring(root, encoding="unicode"), tmp_path)
    never = proposal.card.collision.never
    assert ("left_hip_pitch_link" in never["pelvis"]) is not is_drawn
    assert "left_knee_link" not in never["pelvis"], "four joints further down it is no neighbour"
    assert "right_hip_pitch_link" not in never["left_hip_pitch_link"]


def test_pairs_that_touch_in_some_configurations_are_checked(usual: Proposal) -> None:
    """Every pair is counted anew with data of its own: two that touch now and then, but not at rest, need a check."""
    robot, configurations = usual.robot, 51  # in the last of them, pairs are near that touch in few others
    model, geometry = robot.model, robot.collision
    links = [str(model.frames[shape.parentFrame].name) for shape in geometry.geometryObjects]
    joint_of = [shape.parentJoint for shape in geometry.geometryObjects]
    rng = np.random.default_rng(0)
    draws = [rng.uniform(model.lowerPositionLimit[7:], model.upperPositionLimit[7:]) for _ in range(configurations)]
    qs = [robot.q_reference, *(np.concatenate([robot.q_reference[:7], angles]) for angles in draws)]
    touching = np.zeros((len(qs), len(geometry.collisionPairs)), bool)
    for row, q in zip(touching, qs, strict=True):
        results = geometry.createData()
        pin.computeCollisions(model, model.createData(), geometry, results, q, False)
        row[:] = [result.isCollision() for result in results.collisionResults]
    never = never_colliding(robot, configurations)
    for pair, touches in zip(geometry.collisionPairs, touching.T, strict=True):
        apart = len(set(model.supports[joint_of[pair.first]]) ^ set(model.supports[joint_of[pair.second]]))
        if not touches[0] and 0 < touches[1:].sum() < 0.9 * configurations and apart > 4:
            assert links[pair.second] not in never.get(links[pair.first], ())


def test_marks_of_a_sole_are_not_its_shape(tmp_path: Path, usual: Proposal) -> None:
    """Small solids that are only drawn, 5 mm below the sole, as some makers mark its middle."""
    root = ET.fromstring(Humanoid().urdf())
    mark = ET.SubElement(root, "link", name="mark")
    shape = ET.SubElement(mark, "visual")
    ET.SubElement(ET.SubElement(shape, "geometry"), "box", size="0.01 0.01 0.01")
    joint = ET.SubElement(root, "joint", name="mark_joint", type="fixed")
    ET.SubElement(joint, "origin", xyz=f"{SOLE_AHEAD_M} 0 {-SOLE_DROP_M}")
    ET.SubElement(joint, "parent", link="left_ankle_roll_link")
    ET.SubElement(joint, "child", link="mark")
    proposal = proposal_of_text(ET.tostring(root, encoding="unicode"), tmp_path)
    assert proposal.card.effectors["left_foot"] == usual.card.effectors["left_foot"]
    assert "only a mark" in proposal.assumed["link mark: collision"]


def test_a_drawn_part_of_the_body_collides(tmp_path: Path) -> None:
    root = ET.fromstring(Humanoid().urdf())
    for link in root.findall("link"):
        if link.attrib["name"] == "left_wrist_link":
            link.remove(link.findall("collision")[0])
    plain, assumed = rebuilt(ET.tostring(root, encoding="unicode"), tmp_path)
    assert plain.find("link[@name='left_wrist_link']/collision") is not None
    assert not assumed


def test_colours_up_to_255_are_those_up_to_1(tmp_path: Path) -> None:
    root = ET.fromstring(Humanoid().urdf())
    visual = root.find("link/visual")
    assert visual is not None
    ET.SubElement(ET.SubElement(visual, "material", name="paint"), "color", rgba="255 51 0 255")
    plain, _ = rebuilt(ET.tostring(root, encoding="unicode"), tmp_path)
    color = plain.find("link/visual/material/color")
    assert color is not None
    assert [float(value) for value in color.attrib["rgba"].split()] == [1.0, 0.2, 0.0, 1.0]


def test_joints_that_move_no_mass_are_fixed(tmp_path: Path) -> None:
    root = ET.fromstring(Humanoid().urdf())
    for parent, child in (("left_wrist_link", "finger_1"), ("finger_1", "finger_2")):
        ET.SubElement(root, "link", name=child)
        joint = ET.SubElement(root, "joint", name=f"{child}_joint", type="revolute")
        ET.SubElement(joint, "parent", link=parent)
        ET.SubElement(joint, "child", link=child)
        ET.SubElement(joint, "axis", xyz="0 1 0")
        ET.SubElement(joint, "limit", lower="0", upper="1", effort="1", velocity="1")
    plain, assumed = rebuilt(ET.tostring(root, encoding="unicode"), tmp_path)
    fixed = {joint.attrib["name"] for joint in plain.iter("joint") if joint.attrib["type"] == "fixed"}
    assert fixed == {"finger_1_joint", "finger_2_joint"}
    assert assumed.keys() == {f"joint {name}: type" for name in fixed}
