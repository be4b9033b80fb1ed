"""A robot's card is refused with the names of the fields that make no sense."""

import re
import subprocess
import sys

import pytest

from stridelab.errors import InvalidInput, NotFound, Unavailable
from stridelab.robots import card as cards
from stridelab.robots.assembly import assemble_robot
from stridelab.robots.card import DataCard, card_bytes, parse_card, robot_card, robot_names
from stridelab.robots.data_files import data_files
from stridelab.robots.loader import load_robot

TALOS = card_bytes("talos").decode()


def edited(old: str, new: str) -> bytes:
    assert old in TALOS
    return TALOS.replace(old, new).encode()


def faults(text: bytes) -> list[str]:
    with pytest.raises(InvalidInput) as caught:
        parse_card("talos", text)
    assert caught.value.code == "robot-card-invalid"
    assert all(fault.where in caught.value.message for fault in caught.value.faults)
    return [fault.where for fault in caught.value.faults]


def test_the_shipped_card_of_talos_has_effectors_soles_and_licence() -> None:
    card = robot_card("talos")
    assert list(card.effectors) == ["left_foot", "right_foot", "left_hand", "right_hand"]
    assert card.effectors["left_foot"].contact_half_size_m == (0.10, 0.06)
    assert card.effectors["right_hand"].contact_half_size_m is None
    assert "CC BY-NC-ND" in card.licence


@pytest.mark.parametrize(
    ("old", "new", "where"),
    [
        ('title = "TALOS"', "title = 3", "title"),
        ('title = "TALOS"', "", "title"),
        ('title = "TALOS"', 'title = "TALOS"\ncolour = "grey"', "colour"),
        ('package = "example_robot_data"', 'package = "example.robot-data"', "data.package"),
        ('posture = "half_sitting"', "posture = 1", "reference.posture"),
        ('srdf = "talos_data/srdf/talos.srdf"', "", "reference.posture"),
        ('urdf = "talos_data/robots/', 'urdf = "../talos_data/robots/', "data.urdf"),
        ('srdf = "talos_data/', 'srdf = "/talos_data/', "data.srdf"),
        ("[groups]", "[rotors.armature_kg_m2]\n'leg_.*' = 0.0\n[groups]", "rotors.armature_kg_m2.leg_.*"),
        ("[groups]", "[limits.torque_nm]\nleg = -1.0\n[groups]", "limits.torque_nm.leg"),
        ("[groups]", "[limits.position_rad]\nleg = [0.2, 0.2]\n[groups]", "limits.position_rad.leg"),
        ("[groups]", "[limits.position_rad]\nleg = [0.2]\n[groups]", "limits.position_rad.leg[1]"),
        ("[groups]", "[limits.velocity_rad_s]\n'leg(' = 1.0\n[groups]", "limits.velocity_rad_s.leg("),
        ("[groups]", "[limits.position_rad]\nleg = [-180.0, 90.0]\n[groups]", "limits.position_rad.leg"),
        ("[groups]", "[limits.position_rad]\nleg = [nan, 1.0]\n[groups]", "limits.position_rad.leg[0]"),
        ("[groups]", "[limits.velocity_rad_s]\nleg = 0.0\n[groups]", "limits.velocity_rad_s.leg"),
        ("[groups]", "[limits.velocity_rad_s]\nleg = -3.0\n[groups]", "limits.velocity_rad_s.leg"),
        ("[groups]", "[limits.velocity_rad_s]\nleg = inf\n[groups]", "limits.velocity_rad_s.leg"),
        ("[groups]", "[limits.velocity_rad_s]\nleg = [-3.0, 3.0]\n[groups]", "limits.velocity_rad_s.leg"),
        ("[groups]", "[limits.torque_nm]\nleg = nan\n[groups]", "limits.torque_nm.leg"),
        ("[groups]", "[limits.torque_nm]\nleg = 'strong'\n[groups]", "limits.torque_nm.leg"),
        ("[groups]", "[collision.never]\nleg = ['*']\n[groups]", "collision.never.leg[0]"),
        ("leg_left_6_joint = 0.0", "leg_left_6_joint = inf", "reference.joints_rad.leg_left_6_joint"),
        ('leg = "leg_.*"', 'leg = "leg_("', "groups.leg"),
        ('leg = "leg_.*"', 'wheel = "leg_.*"', "groups.wheel.[key]"),
        ('"wrist_.*_ft_.*"', '"wrist_[ft_.*"', "collision.left_out[1]"),
        ('locked_joints = ["gripper_.*"', 'locked_joints = ["*"', "locked_joints[0]"),
        ('kind = "surface"', 'kind = "blob"', "effectors.left_foot.kind"),
        ("contact_half_size_m = [0.10, 0.06]", "", "effectors.left_foot.contact_half_size_m"),
        ("half_size_m = [0.10, 0.06]", "half_size_m = [0.1]", "effectors.left_foot.contact_half_size_m[1]"),
        (
            "contact_half_size_m = [0.10, 0.06]",
            "contact_half_size_m = [0.1, -0.1]",
            "effectors.left_foot.contact_half_size_m",
        ),
        ("position_m = [0.0, 0.0, -0.11]", "position_m = [0.0, 0.0, true]", "effectors.left_hand.position_m[2]"),
        (
            "orientation_wxyz = [0.0, 0.0, 0.0, 1.0]",
            "orientation_wxyz = [0.0, 0.0, 0.0, 0.5]",
            "effectors.right_hand.orientation_wxyz",
        ),
    ],
)
def test_a_bad_field_is_named(old: str, new: str, where: str) -> None:
    assert where in faults(edited(old, new))


def test_every_bad_field_is_named_at_once() -> None:
    text = edited('title = "TALOS"', "title = 3").replace(b'frame = "left_sole_link"', b"frame = 4")
    assert faults(text) == ["title", "effectors.left_foot.frame"]


@pytest.mark.parametrize("text", [b"title = ", b"\xff\xfe", b""])
def test_a_file_that_is_no_card_is_refused(text: bytes) -> None:
    assert faults(text) is not None


def test_a_robot_without_feet_is_refused() -> None:
    text = re.sub(r"\[effectors\.(left|right)_foot\].*?\n\n", "", TALOS, flags=re.DOTALL)
    assert faults(text.encode()) == ["effectors"]


@pytest.mark.parametrize(
    ("old", "new", "where"),
    [
        ('references = ["stasse2017talos"]', 'references = ["nobody2000"]', "references[0]"),
        ('base_frame = "base_link"', 'base_frame = "chassis"', "base_frame"),
        ('base_frame = "base_link"', "base_frame = 2020-01-01", "base_frame"),
        ('posture = "half_sitting"', 'posture = "asleep"', "reference.posture"),
        ("leg_left_6_joint = 0.0", "leg_left_9_joint = 0.0", "reference.joints_rad.leg_left_9_joint"),
        ('frame = "left_sole_link"', 'frame = "left_shoe"', "effectors.left_foot.frame"),
        ('"leg_left_5_joint", "leg_left_6_joint"', '"leg_left_5_joint", "head_1_joint"', "effectors.left_foot.ankle"),
        ('"head_.*"]', '"tail_.*", "head_.*"]', "locked_joints[1]"),
        ('"rgbd_.*"', '"lidar_.*"', "collision.left_out[2]"),
        ('arm = "arm_.*"', 'arm = "arm_left_.*"', "groups"),
        ('torso = "torso_.*"', 'torso = "(torso|leg)_.*"', "groups"),
    ],
)
def test_names_missing_in_the_description_are_listed(old: str, new: str, where: str) -> None:
    text = edited(old, new)
    card = parse_card("talos", text)
    with pytest.raises(InvalidInput) as caught:
        assemble_robot("talos", card, data_files(card))
    assert {fault.where for fault in caught.value.faults} == {where}


def test_an_unknown_robot_is_not_found_and_the_known_ones_are_named() -> None:
    for ask in (load_robot, robot_card):
        with pytest.raises(NotFound, match="talos") as caught:
            ask("../talos")
        assert caught.value.code == "robot-not-found"


@pytest.mark.parametrize(
    ("data", "lacks"),
    [
        (DataCard("a.urdf", "no_such_package", "a.srdf"), "not installed"),
        (DataCard("a.urdf", "email", "a.srdf"), "without its data"),
        (DataCard("talos_data/no.urdf", "example_robot_data", "a.srdf"), "no.urdf"),
    ],
)
def test_a_robot_whose_data_package_is_missing_is_unavailable(
    monkeypatch: pytest.MonkeyPatch, data: DataCard, lacks: str
) -> None:
    package = f'package = "{data.package}"\nurdf = "{data.urdf}"\nsrdf = "{data.srdf}"'
    text = re.sub(r'package = "example_robot_data".*?(?=\n\n)', package, TALOS, flags=re.DOTALL).encode()
    monkeypatch.setattr("stridelab.robots.loader.card_bytes", lambda name: text)
    with pytest.raises(Unavailable, match=lacks) as caught:
        load_robot.__wrapped__("talos")
    assert caught.value.code == "robot-data-missing"
    assert "TALOS" in caught.value.message


def test_names_and_cards_need_no_rigid_body_library() -> None:
    program = (
        "import sys; from stridelab.robots.loader import robot_names; from stridelab.robots.card import robot_card;"
        "from stridelab.robots.data_files import data_files; data_files(robot_card(robot_names()[0]));"
        "print({'pinocchio', 'example_robot_data', 'trimesh'} & set(sys.modules))"
    )
    run = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "set()"


def test_every_shipped_card_is_valid() -> None:
    assert [cards.robot_card(name).title for name in robot_names()]
