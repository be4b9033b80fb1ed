"""Facts and meshes of a robot, and the child processes that compute them."""

import asyncio
import json
import shutil
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
import trimesh
from pydantic import ValidationError

from stridelab.errors import NotFound, Unavailable
from stridelab.machine.models_folder import models_dir
from stridelab.reachability.store import load_card
from stridelab.robots.card import card_bytes
from stridelab.robots.loader import load_robot
from stridelab.schemas.robots import RobotFacts
from stridelab.service.kinds.robots import description, links
from stridelab.service.processes.child import with_json
from stridelab.service.processes.pool import IsolatedPool
from stridelab.service.processes.running_child import IsolatedOutcome
from support.command_line import RecordedProgress, quiet

KINDS = "stridelab.service.kinds"


@pytest.fixture(scope="module")
def facts(tmp_path_factory: pytest.TempPathFactory) -> RobotFacts:
    progress = RecordedProgress()
    value = with_json(description.run)({"robot": "talos"}, tmp_path_factory.mktemp("facts"), progress)
    assert progress.fractions[-1] == 1.0
    assert value["artifacts"] == []
    return RobotFacts.model_validate(value["summary"])


def test_facts_of_talos(facts: RobotFacts) -> None:
    assert (facts.name, facts.title) == ("talos", "TALOS")
    assert facts.mass_kg == pytest.approx(90.27, abs=0.005)
    assert facts.com_height_m == pytest.approx(0.877, abs=1e-3)
    assert "CC BY-NC-ND" in facts.licence
    assert facts.sha256 == load_robot("talos").sha256
    assert len(facts.q_reference) == 7 + len(facts.limits) == 35
    assert len(facts.links) == 29
    assert facts.links[0] == "base_link"


def test_effectors_of_talos(facts: RobotFacts) -> None:
    named = {effector.name: effector for effector in facts.effectors}
    assert list(named) == ["left_foot", "right_foot", "left_hand", "right_hand"]
    assert [effector.kind for effector in facts.effectors] == ["surface", "surface", "point", "point"]
    assert named["left_foot"].contact_half_size_m == (0.10, 0.06)
    assert named["right_hand"].position_m == (0.0, 0.0, -0.11)
    assert named["right_hand"].orientation_wxyz == (0.0, 0.0, 0.0, 1.0)


def test_limits_of_talos(facts: RobotFacts) -> None:
    """Figures of the robot's description, read by hand."""
    knee = next(limit for limit in facts.limits if limit.joint == "leg_left_4_joint")
    assert (knee.group, knee.lower_rad, knee.torque_nm, knee.velocity_rad_s) == ("leg", 0.0, 300.0, 7.0)
    assert knee.upper_rad == pytest.approx(np.radians(150), abs=1e-4)
    wrist = next(limit for limit in facts.limits if limit.joint == "arm_right_7_joint")
    assert (wrist.group, wrist.torque_nm) == ("arm", 6.6)
    assert all(
        limit.lower_rad <= angle <= limit.upper_rad
        for limit, angle in zip(facts.limits, facts.q_reference[7:], strict=True)
    )


def test_links_of_talos_are_where_the_reference_posture_has_them(facts: RobotFacts) -> None:
    """The soles of the description, 0.107 m below the ankles, lie on the ground on both sides of the origin."""
    poses = dict(zip(facts.links, facts.link_poses, strict=True))
    assert poses["base_link"][:3] == pytest.approx(facts.q_reference[:3])
    feet = np.array([poses["leg_left_6_link"], poses["leg_right_6_link"]])
    assert feet[:, 3:] == pytest.approx(np.array([[1.0, 0.0, 0.0, 0.0]] * 2), abs=1e-3)
    assert feet[:, :3].mean(axis=0) == pytest.approx([0.0, 0.0, 0.107], abs=1e-3)
    assert feet[0, 1] > 0.05


def test_proxies_are_those_of_the_reachability_file(facts: RobotFacts) -> None:
    stored = json.loads((models_dir() / "reachability" / "talos" / "uniform.json").read_text(encoding="utf-8"))
    proxies = [proxy for proxy in facts.proxies if proxy.measure == "uniform"]
    assert [proxy.effector for proxy in proxies] == list(stored["effectors"])
    assert "uniform" in facts.measures
    assert facts.default_measure in facts.measures
    for proxy in proxies:
        learned = stored["effectors"][proxy.effector]
        assert proxy.components == len(learned["weights"])
        assert (proxy.samples, proxy.tried, proxy.seed) == (stored["samples"], stored["tried"], stored["seed"])
        assert (proxy.kl_nats, list(proxy.mode_m)) == (learned["kl_nats"], learned["mode_m"])
        assert (proxy.frame, proxy.thesis_components) == (learned["frame"], learned["thesis_components"])
        assert proxy.rejected_share == pytest.approx(1.0 - stored["samples"] / stored["tried"])
        assert [size.components for size in proxy.sizes] == list(range(1, 21))
        assert (proxy.learned_on, proxy.versions) == (stored["learned_on"], stored["versions"])


def test_a_robot_whose_reach_was_never_learned_is_described(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "robots").mkdir()
    shutil.copy(models_dir() / "robots" / "talos.toml", tmp_path / "robots")
    monkeypatch.setattr("stridelab.reachability.store.models_dir", lambda: tmp_path)
    load_card.cache_clear()
    try:
        described = description.robot_facts(load_robot("talos"))
    finally:
        load_card.cache_clear()
    assert (described.proxies, described.measures, described.stale_measures) == ([], [], [])
    assert len(described.limits) == 28


def test_densities_of_another_description_are_not_the_robots(monkeypatch: pytest.MonkeyPatch) -> None:
    other = replace(load_card("talos", "uniform"), robot_sha256="0" * 64)
    monkeypatch.setattr(description, "learned_cards", lambda _name: [other])
    described = description.robot_facts(load_robot("talos"))
    assert (described.proxies, described.measures, described.stale_measures) == ([], [], ["uniform"])


def test_links_come_as_one_named_node_each(tmp_path: Path, facts: RobotFacts) -> None:
    progress = RecordedProgress()
    value = with_json(links.run)({"robot": "talos"}, tmp_path, progress)
    assert progress.fractions[-1] == 1.0
    assert value["summary"]["links"] == facts.links
    assert value["summary"]["sha256"] == facts.sha256
    assert value["artifacts"] == [{"name": "links.glb", "media_type": "model/gltf-binary"}]
    assert [path.name for path in tmp_path.iterdir()] == ["links.glb"]
    scene = trimesh.load(tmp_path / "links.glb", process=False)
    assert isinstance(scene, trimesh.Scene)
    assert sorted(scene.graph.nodes_geometry) == sorted(facts.links)


@pytest.mark.parametrize("kind", [description, links])
def test_unknown_and_missing_robots(kind: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(NotFound) as unknown:
        with_json(kind.run)({"robot": "hal"}, tmp_path, quiet)
    assert unknown.value.code == "robot-not-found"
    with pytest.raises(ValidationError):
        with_json(kind.run)({"robot": "talos", "colour": "grey"}, tmp_path, quiet)
    absent = card_bytes("talos").replace(b'package = "example_robot_data"', b'package = "no_such_package"')
    monkeypatch.setattr("stridelab.robots.loader.card_bytes", lambda _name: absent)
    load_robot.cache_clear()
    try:
        with pytest.raises(Unavailable) as missing:
            with_json(kind.run)({"robot": "talos"}, tmp_path, quiet)
    finally:
        load_robot.cache_clear()
    assert missing.value.code == "robot-data-missing"
    assert not list(tmp_path.iterdir())


def test_children_answer_like_the_functions_that_they_run(tmp_path: Path, facts: RobotFacts) -> None:
    """The service runs both in children of their own, with their memory limited."""

    async def ask(target: str, robot: str) -> IsolatedOutcome:
        async with IsolatedPool() as pool:
            return await pool.run(f"{KINDS}.{target}:run", {"robot": robot}, tmp_path, timeout_s=60.0, memory_mb=2048)

    described = asyncio.run(ask("robots.description", "talos"))
    assert described.state == "ok", described.log_tail
    assert RobotFacts.model_validate(described.value["summary"]) == facts
    refused = asyncio.run(ask("robots.links", "hal"))
    assert (refused.state, refused.as_error().code) == ("error", "robot-not-found")
