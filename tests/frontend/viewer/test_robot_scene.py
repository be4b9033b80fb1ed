"""The scene of a robot has all that its page may show; a plan has its densities and the imitated person."""

import io
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import trimesh

from stridelab.schemas.robots import RobotFacts
from stridelab_web.scene.density_nodes import reach_places, repeated_nodes
from stridelab_web.scene.documents import Document
from stridelab_web.scene.result_files import PERSON, read_plan
from stridelab_web.viewer.robot_scene import sights_m
from stridelab_web.viewer.scene_builders import document_kinds
from stridelab_web.viewer.scene_limits import SceneLimits
from stridelab_web.viewer.scene_pool import OpenScene, ScenePool
from support.fakes import reachability, robots
from support.fakes.service import FakeService


@pytest.fixture
def library(fake: FakeService) -> Iterator[ScenePool]:
    made = ScenePool(document_kinds(fake.client(), lambda _: fake.client()), SceneLimits(8))
    yield made
    made.close_all()


def nodes(scene: OpenScene) -> dict[str, Any]:
    return dict(scene.server.scene._handle_from_node_name)


def test_a_robot_stands_with_each_density_at_its_effector(library: ScenePool) -> None:
    scene_nodes = nodes(library.open_scene(Document("robot", "boxes")))
    for link, pose in zip(robots.LINKS, robots.REFERENCE, strict=True):
        assert tuple(scene_nodes[f"/robot/{link}"].position) == pytest.approx(pose[:3])
    for measure in reachability.MEASURES:
        for each in reachability.reach(measure).effectors:
            name = f"/reach/{measure}/{each.card.effector}"
            assert tuple(scene_nodes[name].position) == pytest.approx(each.reference_pose[:3])
            assert tuple(scene_nodes[name].wxyz) == pytest.approx(each.reference_pose[3:])
            assert {f"{name}/{part}" for part in ("cloud", "mode", "50", "80", "95")} <= set(scene_nodes)
            assert len(scene_nodes[f"{name}/95"].vertices) == 6
            assert len(scene_nodes[f"{name}/cloud"].points) == 300


def test_the_first_view_shows_a_robot_to_the_top_of_its_head() -> None:
    """A link that is turned by 90 degrees: its long axis points up."""
    half = np.sqrt(0.5)
    facts = SimpleNamespace(
        com_height_m=0.5, links=["body", "head", "empty"],
        link_poses=[(0.0, 0.0, 0.5, 1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 1.1, half, 0.0, -half, 0.0), (0.0,) * 7],
    )  # fmt: skip
    links = {"body": trimesh.creation.box((0.2, 0.2, 0.4)), "head": trimesh.creation.box((0.4, 0.1, 0.1))}
    corners_m = sights_m(cast(RobotFacts, facts), links)
    assert np.ptp(corners_m, axis=0) == pytest.approx([0.95, 0.95, 1.3])
    assert sights_m(cast(RobotFacts, facts), {})[:, 2].max() == pytest.approx(2.05 * 0.5)


def test_a_robot_of_which_nothing_was_learned_stands_alone(fake: FakeService, library: ScenePool) -> None:
    fake.measures = []
    scene_nodes = nodes(library.open_scene(Document("robot", "boxes")))
    assert "/robot/base_link" in scene_nodes
    assert not any(name.startswith("/reach/") for name in scene_nodes)


def test_what_was_learned_since_is_shown(fake: FakeService, library: ScenePool) -> None:
    fake.measures = ["uniform"]
    assert "/reach/conditioned/left_foot" not in nodes(library.open_scene(Document("robot", "boxes")))
    fake.measures = ["uniform", "conditioned"]
    assert "/reach/conditioned/left_foot" in nodes(library.open_scene(Document("robot", "boxes")))


def test_another_robot_of_the_same_name_is_drawn_as_itself(
    fake: FakeService, library: ScenePool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One's own robot may be deleted, and another one uploaded under its name, while the viewer runs."""
    first = nodes(library.open_scene(Document("robot", "boxes")))["/robot/base_link"].vertices
    facts, glb = robots.robot, trimesh.Scene()
    for link in robots.LINKS:
        glb.add_geometry(trimesh.creation.box((0.5, 0.5, 0.5)), node_name=link, geom_name=link)
    changed = lambda *measures: facts(*measures).model_copy(update={"sha256": "1" * 64})  # noqa: E731
    monkeypatch.setattr(robots, "robot", changed)
    monkeypatch.setattr(robots, "links_glb", lambda: bytes(glb.export(file_type="glb")))
    second = nodes(library.open_scene(Document("robot", "boxes")))["/robot/base_link"].vertices
    assert np.ptp(second, axis=0) == pytest.approx([0.5, 0.5, 0.5], abs=1e-3)
    assert np.ptp(first, axis=0) != pytest.approx([0.5, 0.5, 0.5], abs=1e-3)


@pytest.mark.parametrize("learned", [True, False])
def test_a_plan_has_a_level_set_at_each_contact(fake: FakeService, library: ScenePool, learned: bool) -> None:
    fake.measures = ["uniform"] if learned else []
    scene_nodes = nodes(library.open_scene(Document("plan", fake.add_plan().id)))
    places = reach_places(robots.scenario())
    assert {place.name for place in places} <= set(scene_nodes)
    drawn_as_another = dict(repeated_nodes(places))
    assert all(hasattr(scene_nodes[p.name], "vertices") == learned for p in places if p.name not in drawn_as_another)
    assert not any(hasattr(scene_nodes[name], "vertices") for name in drawn_as_another), "the page gives it the meshes"
    if learned:
        rail = next(place for place in places if place.contact.effector == "right_hand")
        assert tuple(scene_nodes[rail.name].position) == pytest.approx(rail.contact.position_m)


def test_a_plan_shows_the_densities_of_its_own_measure(fake: FakeService, library: ScenePool) -> None:
    job = fake.add_plan()
    fake.inputs[job.id] = {"scenario_id": None, "measure": "conditioned"}
    scene_nodes = nodes(library.open_scene(Document("plan", job.id)))
    first = reach_places(robots.scenario())[0]
    middle = reachability.MIDDLE_M["conditioned"][2]
    assert scene_nodes[first.name].vertices[:, 2].mean() == pytest.approx(middle, abs=1e-6)


def test_the_imitated_person_is_in_the_scene(fake: FakeService, library: ScenePool) -> None:
    job, time_s = fake.add_plan(), np.array([0.0, 1.0, 2.0])
    points = {f"{name}_{axis}_m": 0.1 + time_s for name in ("com", "l_hip", "l_knee") for axis in "xyz"}
    sink = io.BytesIO()
    pq.write_table(pa.table({"time_s": time_s, **points}), sink)
    fake.plans[job.id] = {**fake.plans[job.id], PERSON: sink.getvalue()}
    layout = read_plan(fake.plans[job.id])[1].to_layout()
    moved = {node[0] for key in ("points", "sticks") for node in layout[key] if node[0].startswith("/person/")}
    assert moved == {"/person/com", "/person/thigh/l"}
    assert moved <= set(nodes(library.open_scene(Document("plan", job.id))))
