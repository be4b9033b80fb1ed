"""Effectors and their reach as the contact floor reads them."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from stridelab.contacts import effector_geometry
from stridelab.contacts.effector_geometry import EffectorReach, effector_shapes
from stridelab.errors import InvalidInput, NotFound
from stridelab.robots import card as cards

CARD = """
title = "Stick"
licence = "none"
base_frame = "stick"
reference = {}
groups = { leg = ".*" }

[data]
urdf = "stick.urdf"

[effectors.left_foot]
frame = "foot"
kind = "surface"
contact_half_size_m = [0.1, 0.05]

[effectors.right_hand]
frame = "hand"
kind = "point"
position_m = [0.0, 0.0, -0.1]
"""


def test_talos() -> None:
    talos = effector_shapes("talos")
    assert set(talos) == {"left_foot", "right_foot", "left_hand", "right_hand"}
    assert talos["left_foot"].half_size_m == (0.10, 0.06)
    assert (talos["right_hand"].kind, talos["right_hand"].half_size_m) == ("point", None)


@pytest.mark.parametrize("name", ["nao", "", "../robots/talos", "talos.toml"])
def test_the_refusal_of_an_unknown_robot_lists_the_known_ones(name: str) -> None:
    with pytest.raises(NotFound, match=r"there is g1, hrp2, talos") as caught:
        effector_shapes(name)
    assert caught.value.code == "robot-not-found"


def test_reach_comes_from_what_was_learned(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "robots").mkdir()
    (tmp_path / "reachability" / "stick").mkdir(parents=True)
    (tmp_path / "robots" / "stick.toml").write_text(CARD)
    reach = {"com_low_m": [-1, -1, 0], "com_high_m": [1, 1, 2], "com_distance_max_m": 1.5}
    learned = {"effectors": {"left_foot": {"weights": [1.0], "reach": reach}, "right_hand": {"weights": [1.0]}}}
    (tmp_path / "reachability" / "stick" / "uniform.json").write_text(json.dumps(learned))
    for module in (effector_geometry, cards):
        monkeypatch.setattr(module, "models_dir", lambda: tmp_path)
    stick = effector_shapes("stick")
    assert stick["left_foot"].reach == EffectorReach((-1.0, -1.0, 0.0), (1.0, 1.0, 2.0), 1.5)
    assert stick["left_foot"].half_size_m == (0.1, 0.05)
    assert stick["right_hand"].reach is None


def test_a_broken_card_is_refused_by_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "robots").mkdir()
    (tmp_path / "robots" / "twig.toml").write_text("title = ")
    monkeypatch.setattr(cards, "models_dir", lambda: tmp_path)
    with pytest.raises(InvalidInput, match="twig") as caught:
        effector_shapes("twig")
    assert caught.value.code == "robot-card-invalid"


def test_nothing_heavy_is_loaded() -> None:
    """The service asks in its own process."""
    code = (
        "import sys, stridelab.contacts.validation.validate as v, stridelab.contacts.effector_geometry as s;"
        "s.effector_shapes('talos');"
        "print(sorted({'pinocchio', 'casadi', 'sklearn', 'mujoco'} & set(sys.modules)))"
    )
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert result.stdout.strip() == "[]"
