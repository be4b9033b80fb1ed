"""Descriptions that are no robot are refused, each naming what is wrong with it."""

import re
from pathlib import Path

import numpy as np
import pytest

from stridelab.errors import InvalidInput, StridelabError, Unavailable
from stridelab.robots import data_files as places
from stridelab.robots import loader
from stridelab.robots.assembly import assemble
from stridelab.robots.card import card_bytes, parse
from stridelab.robots.data_files import data_files

CARD = card_bytes("hrp2").decode()
FILES = data_files(parse("hrp2", CARD.encode()))
URDF = FILES.urdf.read_text(encoding="utf-8")


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
    parsed = parse("hrp2", card.encode())
    with pytest.raises(StridelabError) as caught:
        assemble("hrp2", parsed, data_files(parsed))
    return caught.value


def without(pattern: str) -> str:
    return re.sub(pattern, "", URDF, count=1, flags=re.DOTALL)


def link(name: str) -> str:
    found = re.search(rf'<link name="{name}">.*?</link>', URDF, re.DOTALL)
    assert found
    return found.group()


def in_link(name: str, pattern: str, replacement: str) -> str:
    return URDF.replace(link(name), re.sub(pattern, replacement, link(name), count=1, flags=re.DOTALL))


def in_joint(name: str, pattern: str, replacement: str) -> str:
    found = re.search(rf'<joint name="{name}".*?</joint>', URDF, re.DOTALL)
    assert found
    return URDF.replace(found.group(), re.sub(pattern, replacement, found.group()))


@pytest.mark.parametrize(
    ("urdf", "where", "what"),
    [
        (in_link("RLEG_LINK3", "<inertial>.*</inertial>", ""), "joint RLEG_JOINT3", "mass 0 kg"),
        (in_link("BODY", "<inertial>.*</inertial>", ""), "the base", "mass 0 kg"),
        (in_link("LARM_LINK2", 'mass value="[^"]*"', 'mass value="0"'), "joint LARM_JOINT2", "mass 0 kg"),
        (in_link("LARM_LINK2", 'mass value="[^"]*"', 'mass value="-1"'), "joint LARM_JOINT2", "mass -1 kg"),
        (in_link("LARM_LINK2", 'mass value="[^"]*"', 'mass value="heavy"'), "joint LARM_JOINT2", "mass 0 kg"),
        (in_link("LARM_LINK2", 'iyy="[^"]*"', 'iyy="-0.01"'), "joint LARM_JOINT2", "not positive"),
        (in_joint("LLEG_JOINT3", 'lower="[^"]*"', 'lower="3.0"'), "joint LLEG_JOINT3", "from 3 to 2.61799"),
        (in_joint("LLEG_JOINT3", 'lower="[^"]*" upper="[^"]*"', ""), "joint LLEG_JOINT3", "from 0 to 0"),
        (in_joint("LARM_JOINT3", 'effort="[^"]*"', 'effort="0"'), "joint LARM_JOINT3", "effort limit is 0"),
        (in_joint("LARM_JOINT3", 'velocity="[^"]*"', 'velocity="0"'), "joint LARM_JOINT3", "velocity limit is 0"),
    ],
)
def test_what_no_body_and_no_joint_can_be(shelf: Path, urdf: str, where: str, what: str) -> None:
    error = refusal(shelf, urdf=urdf)
    assert isinstance(error, InvalidInput)
    assert error.code == "robot-description-invalid"
    assert where in {fault.where for fault in error.faults}
    assert any(what in fault.message for fault in error.faults if fault.where == where)
    assert where in error.message


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
def test_cards_that_do_not_fit_the_description(shelf: Path, card: str, where: str, what: str) -> None:
    error = refusal(shelf, card=card)
    assert isinstance(error, InvalidInput)
    assert error.code == "robot-card-invalid"
    found = {fault.where: fault.message for fault in error.faults}
    assert where in found
    assert what in found[where]


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


def test_a_mesh_that_is_there_is_found(shelf: Path) -> None:
    """Of the project's own robots ``package://`` is the folder of robots."""
    cube = re.sub(r"<box size=[^>]*>", '<mesh filename="package://hrp2/cube.obj"/>', URDF, count=1)
    corners = "\n".join(f"v {x} {y} {z}" for x in (0, 0.1) for y in (0, 0.1) for z in (0, 0.1))
    faces = ("1 2 4 3", "5 7 8 6", "1 5 6 2", "3 4 8 7", "1 3 7 5", "2 6 8 4")
    (shelf / "hrp2" / "cube.obj").write_text(corners + "\n" + "\n".join(f"f {face}" for face in faces) + "\n")
    (shelf / "hrp2" / "hrp2.urdf").write_text(cube)
    card = parse("hrp2", CARD.encode())
    robot = assemble("hrp2", card, data_files(card))
    assert np.isfinite(robot.q_reference).all()


@pytest.mark.parametrize(
    ("urdf", "code"),
    [
        (URDF[:3000], "robot-data-unreadable"),
        ("", "robot-data-unreadable"),
        ("<robot name='x'/>", "robot-data-unreadable"),
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


def test_the_door_refuses_what_the_card_refuses(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(loader, "card_bytes", lambda _name: CARD.replace('"BODY"', '"HULL"', 1).encode())
    with pytest.raises(InvalidInput, match="HULL"):
        loader.load_robot.__wrapped__("hrp2")
