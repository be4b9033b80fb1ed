"""Cards that a person corrected into nonsense are refused by field; proposed and bundled ones are not."""

from typing import Any

import pytest

from stridelab.errors import InvalidInput
from stridelab.robots.assembly import assemble_robot
from stridelab.robots.card import RobotCard, card_of_fields, robot_card
from stridelab.robots.data_files import DataFiles
from stridelab.robots.loader import load_robot
from stridelab.robots.proposal.corrected_card import check_corrected_card
from stridelab.robots.proposal.propose import card_fields, propose_card, rebuild_description
from stridelab.robots.robot import Robot
from support.robots.humanoid import Humanoid, archive


@pytest.fixture(scope="module")
def proposed_robot(tmp_path_factory: pytest.TempPathFactory) -> tuple[RobotCard, Robot]:
    folder = tmp_path_factory.mktemp("robots")
    (folder / "upload").write_bytes(archive({"small.urdf": Humanoid().urdf()}))
    assumed = rebuild_description(folder / "upload", "small.zip", "small", folder / "robots")
    proposal = propose_card("small", "small", folder / "robots", assumed)
    return proposal.card, proposal.robot


def test_a_proposed_card_is_plausible(proposed_robot: tuple[RobotCard, Robot]) -> None:
    check_corrected_card(*proposed_robot)


@pytest.mark.parametrize("name", ["g1", "hrp2", "talos"])
def test_bundled_cards_are_plausible(name: str) -> None:
    check_corrected_card(robot_card(name), load_robot(name))


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("title", ""),
        ("title", "x" * 200),
        ("licence", "x" * 10_000),
        ("limits.torque_nm.left_knee", 1e300),
        ("limits.velocity_rad_s.left_knee", 1e4),
        ("rotors.armature_kg_m2.left_knee", 50.0),
        ("effectors.left_foot.position_m", [-1e6, 0.0, 0.0]),
        ("effectors.left_hand.position_m", [0.0, 0.0, -0.5]),
        ("effectors.left_foot.contact_half_size_m", [0.1, 0.1]),
        ("effectors.left_foot.contact_half_size_m", [1e9, 1e9]),
    ],
)
def test_nonsense_is_refused_by_field(field: str, value: Any, proposed_robot: tuple[RobotCard, Robot]) -> None:
    card, robot = proposed_robot
    fields: Any = card_fields(card)
    place, keys = fields, field.split(".")
    for key in keys[:-1]:
        place = place[key]
    place[keys[-1]] = value
    assert faults_of(fields, robot) == [field]


def test_soles_stand_on_the_ground_on_links_of_their_own(proposed_robot: tuple[RobotCard, Robot]) -> None:
    card, robot = proposed_robot
    bent: Any = card_fields(card)
    bent["reference"]["joints_rad"]["left_knee"] = 2.0
    assert set(faults_of(bent, robot)) == {"reference.joints_rad"}
    twice: Any = card_fields(card)
    twice["effectors"]["right_foot"] = twice["effectors"]["left_foot"]
    assert faults_of(twice, robot) == ["effectors.right_foot.frame"]


def faults_of(fields: dict[str, Any], robot: Robot) -> list[str]:
    """Fields for which the card ``fields`` with the description of ``robot`` is refused."""
    card = card_of_fields("small", {**fields, "data": {"urdf": "small/robot.urdf"}})
    changed = assemble_robot("small", card, DataFiles(robot.urdf, None, robot.package_dirs[0]))
    with pytest.raises(InvalidInput) as refused:
        check_corrected_card(card, changed)
    assert refused.value.code == "robot-card-invalid"
    return [fault.where for fault in refused.value.faults]
