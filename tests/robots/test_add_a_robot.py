"""The page add-a-robot.md tells the truth: its card makes a robot, its table names every field and every code."""

import dataclasses
import re
import shutil
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from stridelab.machine.models_folder import models_dir
from stridelab.robots import card as cards
from stridelab.robots.loader import load_robot, robot_names
from stridelab.robots.robot import Robot
from stridelab.robots.self_collision import SelfCollision

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "how-to" / "add-a-robot.md").read_text(encoding="utf-8")


@pytest.fixture
def romeo(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Robot]:
    """The card of the page, dropped beside the others."""
    shutil.copytree(models_dir() / "robots", tmp_path / "robots")
    code_block = re.search(r"```toml\n(.*?)```", PAGE, re.DOTALL)
    assert code_block
    (tmp_path / "robots" / "romeo.toml").write_text(code_block.group(1), encoding="utf-8")
    monkeypatch.setattr(cards, "models_dir", lambda: tmp_path)
    assert "romeo" in robot_names()
    yield load_robot.__wrapped__("romeo")
    cards.robot_card.cache_clear()


def test_the_card_of_the_page_is_a_robot(romeo: Robot) -> None:
    assert romeo.title == "Romeo"
    assert romeo.mass_kg == pytest.approx(40.529, abs=1e-3)
    assert len(romeo.joint_names) == 23
    knee = romeo.model.joints[romeo.model.getJointId("LKneePitch")].idx_v
    assert romeo.model.effortLimit[knee] == 90.0
    data = romeo.model.createData()
    pin.framesForwardKinematics(romeo.model, data, romeo.q_reference)
    for side in "lr":
        sole = data.oMf[romeo.model.getFrameId(f"{side}_sole")]
        assert sole.translation[2] == pytest.approx(0.0, abs=1e-6)
        assert sole.rotation == pytest.approx(np.eye(3), abs=1e-6)
    com_m = pin.centerOfMass(romeo.model, data, romeo.q_reference)
    assert np.abs(com_m[:2]).max() < 0.05
    assert not SelfCollision(romeo).any_collision(romeo.q_reference)


def test_every_field_of_a_card_is_explained() -> None:
    for section in (cards.DataCard, cards.ReferenceCard, cards.LimitsCard, cards.RotorsCard, cards.CollisionCard):
        for entry in dataclasses.fields(section):
            assert f"{entry.name}`" in PAGE, entry.name
    for entry in (*dataclasses.fields(cards.RobotCard), *dataclasses.fields(cards.EffectorCard)):
        assert entry.name in PAGE, entry.name


def test_every_refusal_is_listed() -> None:
    folder = ROOT / "backend" / "stridelab" / "robots"
    sources = "".join(path.read_text(encoding="utf-8") for path in folder.glob("*.py"))
    codes = set(re.findall(r'"(robot-[a-z-]+)"', sources)) - {"robot-not-found"}
    assert len(codes) == 5
    assert all(f"`{code}`" in PAGE for code in codes)
