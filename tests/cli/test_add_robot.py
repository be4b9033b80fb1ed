"""``stridelab add-robot``: a card beside the rebuilt description, and refusals that leave nothing."""

import os
import re
from pathlib import Path

import pytest
from typer.testing import CliRunner

from stridelab.cli.app import app
from stridelab.errors import NotEstimable
from stridelab.machine.models_folder import ROBOTS_VARIABLE
from stridelab.robots.card import card_bytes, parse_card, robot_names
from stridelab.schemas.robots import CommissionRobotInput
from support.robots.humanoid import Humanoid, archive


def add(folder: Path, content: bytes, *more: str, name: str = "small") -> tuple[int, str]:
    (folder / "small.zip").write_bytes(content)
    arguments = ["add-robot", str(folder / "small.zip"), "--name", name, "--robots", str(folder / "own"), *more]
    result = CliRunner().invoke(app, [*arguments, "--no-commission"])
    return result.exit_code, result.output


def test_a_robot_is_added_and_known_by_its_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    content = archive({"small.urdf": Humanoid(effort=None).urdf()})
    code, output = add(tmp_path, content)
    assert code == 0, output
    rows = " ".join(output.split())
    assert "limits.torque_nm.left_hip_yaw, 190 N m limits.torque_nm.left_hip_roll, and 10 more" in rows
    assert "small" not in robot_names()
    monkeypatch.setenv(ROBOTS_VARIABLE, str(tmp_path / "own"))
    assert "small" in robot_names()
    assert parse_card("small", card_bytes("small")).effectors["left_foot"].kind == "surface"


def test_a_name_is_replaced_only_on_request(tmp_path: Path) -> None:
    content = archive({"small.urdf": Humanoid().urdf()})
    assert add(tmp_path, content)[0] == 0
    code, output = add(tmp_path, content)
    assert code != 0
    assert "There is a robot named small" in output
    assert add(tmp_path, content, "--force")[0] == 0
    assert add(tmp_path, content, name="talos")[0] != 0


@pytest.mark.parametrize(
    ("content", "words"),
    [(b"PK\x03\x04", "damaged"), (archive({"a.urdf": Humanoid(foot="sphere").urdf()}), "point foot")],
    ids=["no zip", "point feet"],
)
def test_a_refused_robot_leaves_nothing(tmp_path: Path, content: bytes, words: str) -> None:
    code, output = add(tmp_path, content)
    assert code not in (0, 1)
    assert words in output
    assert list((tmp_path / "own" / "robots").iterdir()) == []


def test_a_description_is_read_by_a_process_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def read_nothing(*_: object) -> None:
        os._exit(3)

    monkeypatch.setattr("stridelab.robots.proposal.propose.rebuild_description", read_nothing)
    monkeypatch.setattr("stridelab.machine.parallel._has_one_thread", lambda: True)
    code, output = add(tmp_path, archive({"small.urdf": Humanoid().urdf()}))
    assert code == 1
    assert "ended with exit code 3" in output
    assert list((tmp_path / "own" / "robots").iterdir()) == []


def test_a_robot_stays_if_its_replacement_is_refused(tmp_path: Path) -> None:
    assert add(tmp_path, archive({"small.urdf": Humanoid().urdf()}))[0] == 0
    learned = tmp_path / "own" / "reachability" / "small" / "uniform.json"
    learned.parent.mkdir(parents=True)
    learned.write_text("{}", encoding="utf-8")
    before = {path: path.read_bytes() for path in (tmp_path / "own").rglob("*") if path.is_file()}
    code, output = add(tmp_path, archive({"a.urdf": Humanoid(foot="sphere").urdf()}), "--force")
    assert code != 0
    assert "point foot" in output
    assert {path: path.read_bytes() for path in (tmp_path / "own").rglob("*") if path.is_file()} == before


def test_a_card_that_was_corrected_into_nonsense_is_not_commissioned(tmp_path: Path) -> None:
    assert add(tmp_path, archive({"nonsense.urdf": Humanoid().urdf()}), name="nonsense")[0] == 0
    card = tmp_path / "own" / "robots" / "nonsense.toml"
    text, count = re.subn(r'"left_knee" = 150.0', '"left_knee" = 1e300', card.read_text(encoding="utf-8"), count=1)
    assert count == 1
    card.write_text(text, encoding="utf-8")
    again = CliRunner().invoke(app, ["add-robot", "--robots", str(tmp_path / "own"), "--name", "nonsense"])
    assert again.exit_code not in (0, 1)
    assert "limits.torque_nm.left_knee" in " ".join(again.output.split())


def test_a_robot_is_commissioned_again_with_its_corrected_card(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The learning itself has its own tests; here, what it is given."""
    assert add(tmp_path, archive({"small.urdf": Humanoid().urdf()}))[0] == 0
    card = tmp_path / "own" / "robots" / "small.toml"
    card.write_text(card.read_text(encoding="utf-8").replace('"small"', '"Corrected"', 1), encoding="utf-8")
    titles: list[str] = []

    def commission(request: CommissionRobotInput, robots: Path, _progress: object) -> None:
        titles.append(parse_card(request.robot, (robots / "robots" / f"{request.robot}.toml").read_bytes()).title)
        raise NotEstimable("no-free-configuration", "Stopped here.")

    monkeypatch.setattr("stridelab.pipelines.commissioning.commission_robot.commission_robot", commission)
    arguments = ["add-robot", "--robots", str(tmp_path / "own"), "--name"]
    again = CliRunner().invoke(app, [*arguments, "small"])
    assert (again.exit_code, titles) == (4, ["Corrected"])
    missing = CliRunner().invoke(app, [*arguments, "other"])
    assert missing.exit_code != 0
    assert "There is no robot other" in missing.output


def test_a_robot_of_an_installed_package_is_added_by_its_name(tmp_path: Path) -> None:
    listed = CliRunner().invoke(app, ["add-robot", "--list"])
    assert listed.exit_code == 0, listed.output
    assert "example-robot-data 5." in listed.output
    assert "  romeo_description/urdf/romeo.urdf\n" in listed.output
    arguments = ["--robots", str(tmp_path / "own"), "--no-commission"]
    added = CliRunner().invoke(app, ["add-robot", "example-robot-data/alexander_v1.lowerBodyOnly", *arguments])
    assert added.exit_code == 0, added.output
    card = (tmp_path / "own" / "robots" / "alexander-v1-lowerbodyonly.toml").read_text(encoding="utf-8")
    assert '"title" = "alexander_v1.lowerBodyOnly of example-robot-data 5.' in card


def test_without_a_file_the_name_is_needed(tmp_path: Path) -> None:
    refused = CliRunner().invoke(app, ["add-robot", "--robots", str(tmp_path / "own")])
    assert refused.exit_code not in (0, 1)
    assert "--name: missing" in refused.output


@pytest.mark.parametrize(
    ("named", "words"),
    [
        ("example-robot-dat/romeo", "the nearest is example-robot-data"),
        ("example-robot-data/rome", "romeo_description/urdf/romeo.urdf: one of the nearest names"),
        ("missing.zip", "There is no file missing.zip"),
        ("../missing/robot", "There is no file ../missing/robot"),
    ],
)
def test_what_is_neither_a_file_nor_installed_is_named(tmp_path: Path, named: str, words: str) -> None:
    refused = CliRunner().invoke(app, ["add-robot", named, "--name", "small", "--robots", str(tmp_path / "own")])
    assert refused.exit_code not in (0, 1)
    assert words in refused.output
    assert not (tmp_path / "own").exists()
