"""Descriptions that are no robot are refused, each naming what is wrong with it."""

import re
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest

from stridelab.contacts.terrain import Terrain
from stridelab.errors import InvalidInput, StridelabError, Unavailable
from stridelab.robots import data_files as places
from stridelab.robots import loader
from stridelab.robots.assembly import assemble_robot
from stridelab.robots.card import card_bytes, parse_card
from stridelab.robots.data_files import data_files
from stridelab.robots.inertias import read_link
from stridelab.robots.loader import load_robot
from stridelab.wholebody.replay.mujoco_model import build_simulation

CARD = card_bytes("hrp2").decode()
FILES = data_files(parse_card("hrp2", CARD.encode()))
URDF = FILES.urdf.read_text(encoding="utf-8")
URDF_LIMITS = {
    joint.attrib["name"]: {"velocity_rad_s": float(limit["velocity"]), "torque_nm": float(limit["effort"])}
    for joint in ET.fromstring(URDF).findall("joint")
    for limit in (limit_element.attrib for limit_element in joint.findall("limit"))
}


@pytest.fixture
def shelf(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder of robots of its own, in the place of ``models/robots``."""
    folder = tmp_path / "robots"
    (folder / "hrp2").mkdir(parents=True)
    (folder / "hrp2" / "hrp2.urdf").write_text(URDF)
    (folder / "hrp2.toml").write_text(CARD)
    monkeypatch.setattr(places, "models_dir", lambda: tmp_path)
    return folder


def refusal(shelf: Path, *, urdf: str = URDF, card: str = CARD) -> StridelabError:
    assert (urdf, card) != (URDF, CARD), "nothing was changed"
    (shelf / "hrp2" / "hrp2.urdf").write_text(urdf)
    parsed = parse_card("hrp2", card.encode())
    with pytest.raises(StridelabError) as caught:
        assemble_robot("hrp2", parsed, data_files(parsed))
    return caught.value


def without(pattern: str) -> str:
    return re.sub(pattern, "", URDF, count=1, flags=re.DOTALL)


def link(name: str) -> str:
    element = re.search(rf'<link name="{name}">.*?</link>', URDF, re.DOTALL)
    assert element
    return element.group()


def in_link(name: str, pattern: str, replacement: str) -> str:
    return URDF.replace(link(name), re.sub(pattern, replacement, link(name), count=1, flags=re.DOTALL))


def in_joint(name: str, pattern: str, replacement: str) -> str:
    element = re.search(rf'<joint name="{name}".*?</joint>', URDF, re.DOTALL)
    assert element
    return URDF.replace(element.group(), re.sub(pattern, replacement, element.group()))


def inertia(moment_kg_m2: float) -> str:
    """An inertia that is the same about all axes."""
    return f'<inertia ixx="{moment_kg_m2}" ixy="0" ixz="0" iyy="{moment_kg_m2}" iyz="0" izz="{moment_kg_m2}"/>'


def fixed(parent: str, mass_kg: float, inertia: str, joint: str = "fixed") -> str:
    """The description with one link more, ``ballast``, on a joint of its own."""
    more = f"""
      <link name="ballast"><inertial><mass value="{mass_kg}"/>{inertia}</inertial></link>
      <joint name="ballast" type="{joint}"><parent link="{parent}"/><child link="ballast"/>
        <axis xyz="0 0 1"/><limit lower="0" upper="1" effort="1" velocity="1"/></joint>
    </robot>"""
    return URDF.replace("</robot>", more)


@pytest.mark.parametrize(
    ("urdf", "where", "what"),
    [
        (in_link("RLEG_LINK3", "<inertial>.*</inertial>", ""), "link RLEG_LINK3", "mass 0 kg"),
        (in_link("BODY", "<inertial>.*</inertial>", ""), "link BODY", "mass 0 kg"),
        (in_link("LARM_LINK2", 'mass value="[^"]*"', 'mass value="0"'), "link LARM_LINK2", "an inertia but no mass"),
        (in_link("LARM_LINK2", 'mass value="[^"]*"', 'mass value="-1"'), "link LARM_LINK2", "mass is -1 kg"),
        (in_link("LARM_LINK2", 'mass value="[^"]*"', 'mass value="heavy"'), "link LARM_LINK2", "'heavy', which is no"),
        (
            in_link("LARM_LINK2", 'mass value="[^"]*"', 'mass value="nan"'),
            "link LARM_LINK2",
            "'nan', which is not a number",
        ),
        (in_link("LARM_LINK2", 'iyy="[^"]*"', 'iyy="-0.01"'), "link LARM_LINK2", "it must be at least"),
        (in_link("LARM_LINK2", 'iyy="[^"]*"', 'iyy="0.9"'), "link LARM_LINK2", "exceeds the sum"),
        (in_link("LARM_LINK2", "<inertia .*?>", ""), "link LARM_LINK2", "no ixx of <inertia>"),
        (in_link("LARM_LINK2", "<inertia .*?>", inertia(0.0)), "link LARM_LINK2", "but no inertia"),
        (in_link("LARM_LINK2", "<inertia .*?>", inertia(5e-21)), "link LARM_LINK2", "5e-21 kg m2"),
        (in_link("LARM_LINK2", "<inertia .*?>", inertia(1e-9)), "link LARM_LINK2", "it must be at least"),
        (in_link("LARM_LINK6", "<inertia .*?>", inertia(0.0)), "link LARM_LINK6", "but no inertia"),
        (fixed("LARM_LINK2", 0.1, inertia(5e-21)), "link ballast", "it must be at least"),
        (fixed("LARM_LINK2", 0.1, ""), "link ballast", "no ixx of <inertia>"),
        (fixed("LARM_LINK2", 0.0, inertia(1e-4)), "link ballast", "an inertia but no mass"),
        (fixed("LARM_LINK2", 0.1, inertia(1e-4), "prismatic"), "joint ballast", "it is prismatic"),
        (in_joint("LLEG_JOINT3", 'lower="[^"]*"', 'lower="3.0"'), "joint LLEG_JOINT3", "from 3 to 2.61799"),
        (in_joint("LLEG_JOINT3", 'lower="[^"]*" upper="[^"]*"', ""), "joint LLEG_JOINT3", "from 0 to 0"),
        (in_joint("LARM_JOINT3", 'effort="[^"]*"', 'effort="0"'), "joint LARM_JOINT3", "effort limit is 0"),
        (in_joint("LARM_JOINT3", 'velocity="[^"]*"', 'velocity="0"'), "joint LARM_JOINT3", "velocity limit is 0"),
    ],
)
def test_impossible_inertias_and_limits_are_refused(shelf: Path, urdf: str, where: str, what: str) -> None:
    error = refusal(shelf, urdf=urdf)
    assert isinstance(error, InvalidInput)
    assert error.code == "robot-description-invalid"
    assert where in {fault.where for fault in error.faults}
    assert any(what in fault.message for fault in error.faults if fault.where == where)
    assert where in error.message


@pytest.mark.parametrize("more", [fixed("LARM_LINK2", 0.1, inertia(0.0)), fixed("LARM_LINK2", 0.0, inertia(0.0))])
def test_point_masses_and_frames_are_links_too(shelf: Path, more: str) -> None:
    """The description of TALOS has both; they hang on a link with an inertia of its own."""
    (shelf / "hrp2" / "hrp2.urdf").write_text(more)
    card = parse_card("hrp2", CARD.encode())
    robot = assemble_robot("hrp2", card, data_files(card))
    build_simulation(robot, Terrain(()), 0.7, tuple(robot.effectors))


@pytest.mark.parametrize(
    "urdf",
    [
        fixed("LARM_LINK2", 1e-3, inertia(1.1e-11)),
        fixed("LARM_LINK2", 50.0, inertia(5.1e-7)),
        in_link("LARM_LINK2", "<inertia .*?>", '<inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.02"/>'),
        in_link("LARM_LINK2", "<inertia .*?>", '<inertia ixx="0.02" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.0001"/>'),
    ],
)
def test_barely_accepted_descriptions_are_accepted_by_the_simulator(shelf: Path, urdf: str) -> None:
    (shelf / "hrp2" / "hrp2.urdf").write_text(urdf)
    card = parse_card("hrp2", CARD.encode())
    robot = assemble_robot("hrp2", card, data_files(card))
    simulated = build_simulation(robot, Terrain(()), 0.7, tuple(robot.effectors)).model
    for element in ET.fromstring(urdf).iter("link"):
        stated = read_link(element)
        if stated.mass_kg > 0.0:
            moments = np.sort(simulated.body(stated.name).inertia)
            np.testing.assert_allclose(moments, stated.moments_kg_m2, rtol=1e-5, err_msg=stated.name)


def test_an_impossible_inertia_can_be_accepted_by_name(shelf: Path) -> None:
    flat = in_link("LARM_LINK2", "<inertia .*?>", '<inertia ixx="1e-3" ixy="0" ixz="0" iyy="1e-3" iyz="0" izz="1e-2"/>')
    assert refusal(shelf, urdf=flat).code == "robot-description-invalid"
    accepting = parse_card("hrp2", f'accepted_inertias = ["LARM_LINK2"]\n{CARD}'.encode())
    robot = assemble_robot("hrp2", accepting, data_files(accepting))
    build_simulation(robot, Terrain(()), 0.7, tuple(robot.effectors))
    assert refusal(shelf, card=f'accepted_inertias = ["LARM_LINK9"]\n{CARD}').code == "robot-card-invalid"


@pytest.mark.parametrize(
    ("table", "limit"),
    [("velocity_rad_s", "1.5"), ("velocity_rad_s", "30.0"), ("torque_nm", "20.0"), ("torque_nm", "900.0")],
)
def test_limits_of_the_card_replace_those_of_the_description(shelf: Path, table: str, limit: str) -> None:
    """Lower ones and higher ones, and of the joints that the card names alone."""
    before = load_robot("hrp2")
    text = re.sub(r"\[limits\.torque_nm\]\n(.+\n)+", "", CARD) + f'\n[limits.{table}]\n"[LR]LEG_JOINT3" = {limit}\n'
    card = parse_card("hrp2", text.encode())
    robot = assemble_robot("hrp2", card, data_files(card))
    for name in robot.joint_names:
        joint = robot.model.joints[robot.model.getJointId(name)].idx_v
        knee = name.endswith("LEG_JOINT3")
        for what, model in (("velocity_rad_s", robot.model.velocityLimit), ("torque_nm", robot.model.effortLimit)):
            stated = URDF_LIMITS[name][what]
            assert model[joint] == (float(limit) if knee and what == table else stated), (name, what)
        assert robot.model.lowerVelocityLimit[joint] <= robot.model.upperVelocityLimit[joint]
    assert robot.sha256 != before.sha256


def test_ranges_of_the_card_replace_those_of_the_description(shelf: Path) -> None:
    card = parse_card("hrp2", (CARD + '\n[limits.position_rad]\n"[LR]LEG_JOINT3" = [0.1, 1.5]\n').encode())
    robot = assemble_robot("hrp2", card, data_files(card))
    for side in "LR":
        joint = robot.model.joints[robot.model.getJointId(f"{side}LEG_JOINT3")].idx_q
        assert (robot.model.lowerPositionLimit[joint], robot.model.upperPositionLimit[joint]) == (0.1, 1.5)
    simulated = build_simulation(robot, Terrain(()), 0.7, tuple(robot.effectors)).model
    assert simulated.joint("LLEG_JOINT3").range.tolist() == [0.1, 1.5]


@pytest.mark.parametrize(
    ("card", "where", "what"),
    [
        (CARD.replace('frame = "r_gripper"', 'frame = "CHEST_LINK2"'), "effectors.right_hand.frame", "no frame"),
        (CARD.replace('frame = "r_gripper"', 'frame = "BODY"'), "effectors.right_hand.frame", "no moving joint"),
        (CARD.replace('base_frame = "BODY"', 'base_frame = "r_gripper"'), "effectors.right_hand.frame", "no moving"),
        (
            CARD.replace('"[LR]ARM_JOINT6"]', '"RARM_.*", "CHEST_.*", "LARM_JOINT6"]'),
            "effectors.right_hand.frame",
            "no moving joint",
        ),
        (CARD.replace('"[LR]LEG_JOINT3" = 0.87', '"[LR]LEG_JOINT3" = 2.87'), "reference", "LEG_JOINT3"),
        (CARD.replace("[limits.torque_nm]", '[limits.torque_nm]\n"[LR]LEG_JOINT3" = 1.0'), "limits.torque_nm", "more"),
        (CARD.replace("[limits.torque_nm]", '[limits.torque_nm]\n"KNEE" = 1.0'), "limits.torque_nm.KNEE", "no joint"),
        (CARD.replace("[collision.never]", "[collision.never]\nTAIL = ['BODY']"), "collision.never.TAIL", "no link"),
        (
            CARD.replace("[collision.never]", "[collision]\nmeshes = ['x']\n[collision.never]"),
            "collision.meshes[0]",
            "no",
        ),
        (
            CARD.replace("[collision.never]", "[collision]\nvisual = ['x']\n[collision.never]"),
            "collision.visual[0]",
            "no",
        ),
    ],
)
def test_cards_that_do_not_fit_the_description_are_refused(shelf: Path, card: str, where: str, what: str) -> None:
    error = refusal(shelf, card=card)
    assert isinstance(error, InvalidInput)
    assert error.code == "robot-card-invalid"
    faults = {fault.where: fault.message for fault in error.faults}
    assert where in faults
    assert what in faults[where]


def test_limits_of_the_card_can_be_the_cause(shelf: Path) -> None:
    """A range of the card in which the reference posture does not lie."""
    error = refusal(shelf, card=CARD + '\n[limits.position_rad]\n"[LR]LEG_JOINT3" = [1.0, 2.0]\n')
    assert [fault.where for fault in error.faults] == ["reference", "reference"]


def test_a_missing_mesh_is_named(shelf: Path) -> None:
    meshes = URDF.replace("<box ", '<mesh filename="package://hrp2/shin.stl"/><box ', 1)
    error = refusal(shelf, urdf=meshes)
    assert isinstance(error, Unavailable)
    assert error.code == "robot-meshes-missing"
    assert [fault.where for fault in error.faults] == ["package://hrp2/shin.stl"]


def test_an_existing_mesh_is_loaded(shelf: Path) -> None:
    """Of the project's own robots ``package://`` is the folder of robots."""
    cube = re.sub(r"<box size=[^>]*>", '<mesh filename="package://hrp2/cube.obj"/>', URDF, count=1)
    corners = "\n".join(f"v {x} {y} {z}" for x in (0, 0.1) for y in (0, 0.1) for z in (0, 0.1))
    faces = ("1 2 4 3", "5 7 8 6", "1 5 6 2", "3 4 8 7", "1 3 7 5", "2 6 8 4")
    (shelf / "hrp2" / "cube.obj").write_text(corners + "\n" + "\n".join(f"f {face}" for face in faces) + "\n")
    (shelf / "hrp2" / "hrp2.urdf").write_text(cube)
    card = parse_card("hrp2", CARD.encode())
    robot = assemble_robot("hrp2", card, data_files(card))
    assert np.isfinite(robot.q_reference).all()


@pytest.mark.parametrize(
    ("urdf", "code"),
    [
        (URDF[:3000], "robot-data-unreadable"),
        ("", "robot-data-unreadable"),
        ("<robot name='x'/>", "robot-data-unreadable"),
        ("<sdf version='1.6'><model name='x'><link name='a'/></model></sdf>", "robot-data-unreadable"),
        ("<mujoco model='x'><worldbody><body name='a'/></worldbody></mujoco>", "robot-data-unreadable"),
        (URDF.replace('<parent link="BODY" />', '<parent link="HULL" />'), "robot-data-unreadable"),
    ],
)
def test_a_broken_description_is_named(shelf: Path, urdf: str, code: str) -> None:
    error = refusal(shelf, urdf=urdf)
    assert isinstance(error, Unavailable)
    assert error.code == code
    assert "hrp2.urdf" in error.message
    assert str(shelf) not in error.message


def test_a_description_that_is_not_there_is_named(shelf: Path) -> None:
    error = refusal(shelf, card=CARD.replace("hrp2/hrp2.urdf", "hrp2/hrp3.urdf"))
    assert isinstance(error, Unavailable)
    assert error.code == "robot-data-missing"
    assert "hrp2/hrp3.urdf" in error.message
    assert "HRP-2" in error.message


def test_an_upload_refuses_what_the_card_refuses(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(loader, "card_bytes", lambda _name: CARD.replace('"BODY"', '"HULL"', 1).encode())
    with pytest.raises(InvalidInput, match="HULL"):
        loader.load_robot.__wrapped__("hrp2")
