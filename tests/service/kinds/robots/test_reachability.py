"""What can be drawn of densities: where their frames are, what surfaces and maps hold, and what is refused."""

import gzip
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError

from stridelab.conventions import Points
from stridelab.errors import NotFound, Unavailable
from stridelab.machine.models_folder import models_dir
from stridelab.reachability import store
from stridelab.reachability.card import EffectorCard, ReachabilityCard
from stridelab.robots.loader import load_robot
from stridelab.schemas.reachability import EffectorReach, RobotReachability
from stridelab.service.kinds.robots import reachability as robot_reachability
from stridelab.service.kinds.robots.reachability import plottable_reachability, run
from stridelab.service.processes.child import with_json
from support.command_line import RecordedProgress, quiet

UNIFORM = {"robot": "talos", "measure": "uniform"}


@pytest.fixture(scope="module")
def card() -> ReachabilityCard:
    return store.load_card("talos", "uniform")


@pytest.fixture(scope="module")
def cloud(card: ReachabilityCard) -> dict[str, Points]:
    rng = np.random.default_rng(2)
    return {name: effector.to_mixture().sample(3000, rng) for name, effector in card.effectors.items()}


@pytest.fixture(scope="module")
def drawn(card: ReachabilityCard, cloud: dict[str, Points]) -> dict[str, EffectorReach]:
    reachability = plottable_reachability(load_robot("talos"), card, cloud)
    assert (reachability.robot, reachability.measure) == ("talos", "uniform")
    return {each.card.effector: each for each in reachability.effectors}


def test_frames_are_where_the_reference_posture_has_the_effectors(drawn: dict[str, EffectorReach]) -> None:
    """The posture is symmetric and stands on z = 0; a hand's z axis points away from a bar below it."""
    left, right = (np.array(drawn[f"{side}_foot"].reference_pose) for side in ("left", "right"))
    assert left[:3] == pytest.approx(right[:3] * [1, -1, 1], abs=1e-6)
    assert left[2] == pytest.approx(0.0, abs=1e-6)
    assert left[3:] == pytest.approx([1, 0, 0, 0], abs=1e-6)
    hand, other = (np.array(drawn[f"{side}_hand"].reference_pose) for side in ("left", "right"))
    assert hand == pytest.approx(other * [1, -1, 1, 1, -1, 1, -1], abs=1e-6)
    assert hand[3] < 0.99


def test_a_density_in_the_heading_frame_stands_upright_at_the_same_place(
    card: ReachabilityCard, cloud: dict[str, Points], drawn: dict[str, EffectorReach]
) -> None:
    heading = replace(card.effectors["right_hand"], frame="heading")
    changed = replace(card, effectors={"right_hand": heading})
    (drawn_effector,) = plottable_reachability(load_robot("talos"), changed, cloud).effectors
    assert drawn_effector.reference_pose[:3] == drawn["right_hand"].reference_pose[:3]
    assert drawn_effector.reference_pose[3:] == (1.0, 0.0, 0.0, 0.0)
    assert drawn_effector.card.frame == "heading"


def test_samples_are_the_first_to_the_millimetre(drawn: dict[str, EffectorReach], cloud: dict[str, Points]) -> None:
    for name, effector in drawn.items():
        assert len(effector.com_m) == 2000
        assert np.array(effector.com_m) == pytest.approx(cloud[name][:2000], abs=0.501e-3)


def test_surfaces_lie_where_the_density_is_their_threshold(
    drawn: dict[str, EffectorReach], card: ReachabilityCard
) -> None:
    for name, effector in drawn.items():
        mixture = learned(card, name).to_mixture()
        assert [level.mass for level in effector.level_sets] == [0.5, 0.8, 0.95]
        for level in effector.level_sets:
            log_p = mixture.log_density(np.array(level.vertices_m))
            assert np.median(log_p) == pytest.approx(np.log(level.density_per_m3), abs=0.05)
            assert max(max(triangle) for triangle in level.triangles) == len(level.vertices_m) - 1
        assert effector.card.components == learned(card, name).components


def learned(card: ReachabilityCard, name: str) -> EffectorCard:
    return card.effectors[name]


def test_maps_hold_all_of_both_densities(drawn: dict[str, EffectorReach]) -> None:
    for effector in drawn.values():
        assert [(each.along, each.right, each.up) for each in effector.projections] == [
            ("x", "y", "z"), ("y", "x", "z"), ("z", "x", "y"),
        ]  # fmt: skip
        for each in effector.projections:
            step_m = each.right_m[1] - each.right_m[0]
            assert np.diff(each.up_m) == pytest.approx(step_m, abs=2e-4)
            for values in (np.array(each.kernel_per_m2), np.array(each.mixture_per_m2)):
                assert values.shape == (len(each.up_m), len(each.right_m))
                assert values.sum() * step_m**2 == pytest.approx(1.0, abs=0.02)


def test_the_child_leaves_one_compressed_file(tmp_path: Path) -> None:
    progress = RecordedProgress()
    outcome = with_json(run)(UNIFORM, tmp_path, progress)
    assert progress.fractions[-1] == 1.0
    assert [item["name"] for item in outcome["artifacts"]] == ["reachability.json.gz"]
    assert [path.name for path in tmp_path.iterdir()] == ["reachability.json.gz"]
    packed = (tmp_path / "reachability.json.gz").read_bytes()
    reachability = RobotReachability.model_validate_json(gzip.decompress(packed))
    assert [each.card.effector for each in reachability.effectors] == [
        "left_foot",
        "right_foot",
        "left_hand",
        "right_hand",
    ]
    assert len(packed) < 500_000
    assert reachability.robot_sha256 == load_robot("talos").sha256


def test_unknown_robots_and_measures_and_cards_of_others_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, card: ReachabilityCard
) -> None:
    with pytest.raises(NotFound) as unknown:
        with_json(run)({"robot": "hal", "measure": "uniform"}, tmp_path, quiet)
    assert unknown.value.code == "robot-not-found"
    with pytest.raises(ValidationError):
        with_json(run)({"robot": "talos", "measure": "even"}, tmp_path, quiet)
    other = replace(card, robot_sha256="0" * 64)
    monkeypatch.setattr(robot_reachability, "load_card", lambda _robot, _measure: other)
    with pytest.raises(Unavailable) as another:
        with_json(run)(UNIFORM, tmp_path, quiet)
    assert another.value.code == "reachability-of-another-robot"
    assert not list(tmp_path.iterdir())


def test_an_effector_that_was_not_learned_is_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "reachability").mkdir()
    shutil.copytree(models_dir() / "robots", tmp_path / "robots")
    monkeypatch.setattr("stridelab.reachability.store.models_dir", lambda: tmp_path)
    store.load_card.cache_clear()
    try:
        with pytest.raises(NotFound) as missing:
            with_json(run)(UNIFORM, tmp_path, quiet)
    finally:
        store.load_card.cache_clear()
    assert missing.value.code == "reachability-not-learned"
