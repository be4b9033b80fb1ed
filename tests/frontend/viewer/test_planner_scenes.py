"""Scenes of plans and scenarios: every node that the page moves is there, and a drag ends in the service."""

import asyncio
import math
from collections.abc import Callable, Iterator, Mapping
from importlib.resources import files
from types import MappingProxyType, SimpleNamespace
from typing import Any

import httpx
import numpy as np
import pytest
import trimesh
from viser.infra import ClientId

from stridelab.client import Unreachable
from stridelab.schemas.scenarios import BoxSurface, Scenario, StoredScenario
from stridelab_web.scene.contacts import placed_contacts
from stridelab_web.scene.documents import KEY_HEADER, Document, document_of
from stridelab_web.scene.result_files import read_plan
from stridelab_web.viewer.access_guard import start_guarded_server
from stridelab_web.viewer.initial_posture import Posed, initial_pose
from stridelab_web.viewer.plan_scene import RIGHT_FRONT, is_hidden
from stridelab_web.viewer.robot_links import add_robot, colour_parts, limit_levels, read_links
from stridelab_web.viewer.scenario_scene import COM, CORNERS, EDGE, HELD, HELD_ENDED, PLUMB, REGION, ScenarioScene
from stridelab_web.viewer.scene_builders import document_kinds
from stridelab_web.viewer.scene_limits import SceneLimits
from stridelab_web.viewer.scene_parts import FOV_RAD, WIDE, camera_pose
from stridelab_web.viewer.scene_pool import OpenScene, ScenePool
from stridelab_web.viewer.terrain import faces_m
from support.fakes import robots
from support.fakes.service import FakeService

SIZES = {"left_foot": robots.HALF_M, "right_foot": robots.HALF_M}
POSED = Posed(dict(zip(robots.LINKS, robots.REFERENCE, strict=True)), {})


@pytest.fixture
def library(fake: FakeService) -> Iterator[ScenePool]:
    made = ScenePool(document_kinds(fake.client(), lambda _: fake.client()), SceneLimits(8))
    yield made
    made.close_all()


def names(scene: OpenScene) -> set[str]:
    return set(scene.server.scene._handle_from_node_name)


@pytest.mark.parametrize(("whole_body", "replay"), [(True, False), (True, True), (False, False)])
def test_a_plan_has_every_node_that_the_page_moves(
    fake: FakeService, library: ScenePool, whole_body: bool, replay: bool
) -> None:
    job = fake.add_plan(whole_body=whole_body, replay=replay)
    opened = library.open_scene(Document("plan", job.id))
    layout = read_plan(fake.plans[job.id])[1].to_layout()
    moved = {node[0] for key in ("points", "bodies", "spans") for node in layout[key]}
    moved |= {name for arrow in layout["arrows"] for name in arrow[:2]} | set(layout["still"])
    assert moved <= names(opened)
    assert ("/robot/bare_link" in names(opened)) == whole_body
    for group in ("/ghost/base_link", "/ghost/bare_link", "/measured/left_foot_shaft"):
        assert (group in names(opened)) == (group in moved) == replay
    assert {"/terrain/0", "/terrain/3", "/terrain/0/grid", "/terrain/boxes", "/terrain/boxes/rims"} <= names(opened)


def test_the_ghost_is_the_replay_and_gone_once_it_has_fallen() -> None:
    given = robots.scenario()
    _, frames = read_plan(robots.plan_files(given, replay=True))
    at = {body.name: body.at for body in frames.bodies}
    planned, ghost = (frames.values[:, at[name] : at[name] + 7] for name in ("/robot/base_link", "/ghost/base_link"))
    standing = frames.time_s <= 3.0
    np.testing.assert_allclose((ghost - planned)[standing, 2], 0.01, atol=1e-6)
    assert np.isnan(ghost[~standing]).all()
    assert np.isfinite(planned).all()


def test_links_keep_their_frames() -> None:
    links = read_links(robots.links_glb())
    assert set(links) == set(robots.LINKS) - {"bare_link"}
    assert links["base_link"].bounds == pytest.approx(np.array([[-0.15, -0.2, -0.4], [0.15, 0.2, 0.4]]))


def test_links_keep_their_colours() -> None:
    """As robots/visuals.py writes them: linear light on a material, of which trimesh's own copy keeps no colours."""
    light = np.array([[255, 55, 0, 255]] * 4 + [[8, 8, 8, 255]] * 3, dtype=np.uint8)  # (255, 128, 0) and 51
    faces = [[4, 5, 6], [0, 1, 2], [1, 2, 3]]
    part = trimesh.Trimesh(np.arange(21.0).reshape(7, 3) ** 2, faces, process=False)
    part.visual = trimesh.visual.TextureVisuals(material=trimesh.visual.material.PBRMaterial(metallicFactor=0.0))
    part.visual.vertex_attributes["color"] = light
    scene = trimesh.Scene()
    scene.add_geometry(part, node_name="hand", transform=trimesh.transformations.translation_matrix([0, 0, 2]))
    mesh = read_links(bytes(scene.export(file_type="glb")))["hand"]
    assert mesh.visual.vertex_colors[0, :3] == pytest.approx([255, 128, 0], abs=2)
    assert mesh.visual.vertex_colors[6, :3] == pytest.approx([51, 51, 51], abs=2)
    assert mesh.vertices[0] == pytest.approx([0, 1, 6])
    (vertices, triangles, orange), (_, _, grey) = colour_parts(mesh)
    assert (len(vertices), triangles.tolist()) == (4, [[0, 1, 2], [1, 2, 3]])
    assert vertices[3] == pytest.approx(mesh.vertices[3])
    assert orange == limit_levels(mesh.visual.vertex_colors[0, :3])
    assert 84 < grey[0] < orange[1] < orange[0] == 216


def test_a_link_of_several_colours_is_one_node_that_the_page_moves() -> None:
    box = trimesh.creation.box((1, 1, 1))
    box.visual.vertex_colors = np.where(box.vertices[:, :1] > 0, [255, 0, 0, 255], [0, 0, 0, 255]).astype(np.uint8)
    server, _ = start_guarded_server()
    try:
        made = add_robot(server.scene, ["hand", "bare"], {"hand": box})
        assert set(server.scene._handle_from_node_name) >= {"/robot/hand", "/robot/hand/1", "/robot/bare"}
        assert [handle.name for handle in made.values()] == ["/robot/hand", "/robot/bare"]
    finally:
        server.stop()


def test_what_lies_inside_another_box_is_not_drawn() -> None:
    """A step that runs on below the next one: of its upper face the tread is left, of the next step what rises."""
    turn = math.pi / 2
    low = BoxSurface(name="low", kind="box", center_m=(1.0, 0.0, 0.1), size_m=(2.0, 1.0, 0.2))
    high = BoxSurface(name="high", kind="box", center_m=(1.25, 0.0, 0.2), size_m=(1.0, 1.5, 0.4), yaw_rad=turn)
    assert area_m2(faces_m(low, [])) == pytest.approx(2 * (2.0 * 1.0 + 2.0 * 0.2 + 1.0 * 0.2))
    treads = [face for face in faces_m(low, [high]) if face[:, 2].min() > 0.2 - 1e-9]
    assert np.concatenate(treads).max(axis=0) == pytest.approx([0.5, 0.5, 0.2])
    assert area_m2(faces_m(low, [high])) == pytest.approx(area_m2(faces_m(low, [])) - 1.5)
    risers = [face for face in faces_m(high, [low]) if face[:, 0].max() < 0.5 + 1e-9]
    assert area_m2(np.array(risers)) == pytest.approx(1.0 * 0.2)
    assert np.concatenate(risers)[:, 2].min() == pytest.approx(0.2)
    for face in faces_m(high, [low]):
        outwards = np.cross(face[1] - face[0], face[2] - face[1])
        assert outwards @ (face.mean(axis=0) - high.center_m) > 0
    askew = high.model_copy(update={"yaw_rad": 0.3})
    assert len(faces_m(low, [askew])) == 6
    around = low.model_copy(update={"center_m": (1.0, 0.0, 0.1), "size_m": (3.0, 3.0, 3.0)})
    assert faces_m(low, [around]).shape == (0, 4, 3)


def area_m2(faces: np.ndarray) -> float:
    """Of all the rectangles ``(n, 4, 3)``."""
    return float(np.linalg.norm(np.cross(faces[:, 1] - faces[:, 0], faces[:, 3] - faces[:, 0]), axis=1).sum())


def test_documents_are_known_by_their_address() -> None:
    document = Document("recording", "a", "b")
    assert document.address == "/view/scene/recording/a/b"
    assert document_of({"kind": "recording", "id": "a", "job": "b"}) == document
    assert document_of(document.request_body) == document
    assert document_of({"kind": "plan", "id": "a", "job": "-"}) == Document("plan", "a")
    with pytest.raises(KeyError):
        document_of({"kind": "film", "id": "a", "job": "-"})


def test_the_camera_has_everything_in_sight_and_no_more_than_needed() -> None:
    corners = np.array([[x, y, z] for x in (-1.0, 4.0) for y in (-0.7, 0.7) for z in (0.0, 2.5)])
    towards = np.array([0.3, -1.0, 0.4])
    look_at, eye = camera_pose(corners, towards, WIDE)
    back = (eye - look_at) / np.linalg.norm(eye - look_at)
    assert back == pytest.approx(towards / np.linalg.norm(towards))
    right = np.cross([0, 0, 1], back)
    right /= np.linalg.norm(right)
    up = np.cross(back, right)
    depth = (eye - corners) @ back
    tall = (corners - eye) @ up / depth / np.tan(FOV_RAD / 2)
    wide = (corners - eye) @ right / depth / np.tan(FOV_RAD / 2) / WIDE
    assert max(np.abs(tall).max(), np.abs(wide).max()) <= 1.0
    assert max(np.abs(tall).max(), np.abs(wide).max()) > 0.85


def test_a_wall_beside_the_way_is_not_looked_at_from_behind() -> None:
    given = robots.scenario()
    assert not is_hidden(given, RIGHT_FRONT)
    wall = BoxSurface(name="wall", kind="box", center_m=(0.3, -0.7, 0.8), size_m=(1.5, 0.1, 1.6), yaw_rad=0.0)

    def beside(**changes: Any) -> Scenario:
        return given.model_copy(update={"terrain": [*given.terrain, wall.model_copy(update=changes)]})

    assert is_hidden(beside(), RIGHT_FRONT)
    assert not is_hidden(beside(), RIGHT_FRONT * [1, -1, 1])
    assert not is_hidden(beside(center_m=(0.3, -0.7, 0.4), size_m=(1.5, 0.1, 0.8)), RIGHT_FRONT), "it is low"
    assert not is_hidden(beside(center_m=(6.0, -0.7, 0.8)), RIGHT_FRONT), "it is elsewhere"
    assert not is_hidden(beside(yaw_rad=np.pi / 2, center_m=(2.5, -0.7, 0.8)), RIGHT_FRONT), "it is across the way"


class OwnScene(dict[str, Any]):
    """The frames of one browser alone."""

    def add_frame(self, name: str, *, show_axes: bool, position: Any = (0.0, 0.0, 0.0)) -> SimpleNamespace:
        assert not show_axes
        self[name] = SimpleNamespace(position=position, remove=lambda: self._remove(name))
        node: SimpleNamespace = self[name]
        return node

    def _remove(self, name: str) -> None:
        for each in [each for each in self if each == name or each.startswith(f"{name}/")]:
            del self[each]


class Drag:
    """Plays a person's drag into a scene, as viser would report it."""

    def __init__(
        self,
        scene: ScenarioScene,
        eye_m: tuple[float, float, float] = (-0.4, 1.0, 1.6),
        *,
        headers: Mapping[str, str] = MappingProxyType({KEY_HEADER: "of-somebody"}),
    ) -> None:
        self.scene = scene
        opened: Any = SimpleNamespace(request=SimpleNamespace(headers=headers))
        scene._server._websock_server._live_connections[ClientId(7)] = opened
        self.own = OwnScene()
        self.client = SimpleNamespace(camera=SimpleNamespace(position=eye_m), client_id=7, scene=self.own)

    def __call__(self, number: int, *places: tuple[float, float, float]) -> None:
        start = places[0]
        phases = ["start", *["update"] * (len(places) - 2), "end"]
        for phase, place in zip(phases, places, strict=True):
            event: Any = SimpleNamespace(
                client=self.client, client_id=7, phase=phase, start_position=start, end_position=place
            )
            asyncio.run(self.scene._drag_of(number)(event))


Start = Callable[..., ScenarioScene]


@pytest.fixture
def start() -> Iterator[Start]:
    servers = []

    def make(stored: StoredScenario, put: Any) -> ScenarioScene:
        server, _ = start_guarded_server()
        servers.append(server)
        return ScenarioScene(server, stored, SIZES, put, POSED)

    yield make
    for server in servers:
        server.stop()


def test_a_drag_moves_all_phases_of_a_touch_and_is_stored_once(start: Start) -> None:
    scenario = robots.stored(robots.scenario())
    sent: list[Scenario] = []

    def put(scenario_id: str, body: Scenario, known: StoredScenario, key: str) -> StoredScenario:
        assert (scenario_id, known, key) == (scenario.id, scenario, "of-somebody")
        sent.append(body)
        return robots.stored(body, key=scenario_id)

    scene = start(scenario, put)
    # taken hold of 5 cm beside its middle, on the mark, which lies a little above the tread
    Drag(scene)(5, (0.35, 0.09, 0.1), (0.36, 0.12, 0.1), (0.33, 0.19, 0.1))
    assert len(sent) == 1
    placed = [t.contact.position_m for t in placed_contacts(sent[0])]
    before = [t.contact.position_m for t in placed_contacts(scenario)]
    assert placed[4] == pytest.approx((0.28, 0.19, 0.1))
    assert placed[:4] + placed[5:] == before[:4] + before[5:]
    assert [t.last_phase for t in placed_contacts(sent[0])] == [t.last_phase for t in placed_contacts(scenario)]
    assert tuple(scene._marks[5].position) == pytest.approx((0.28, 0.19, 0.1))
    assert tuple(scene._turn.position) == (1.0, 0.0, 0.0)


def test_a_drag_that_comes_to_nothing_is_not_stored(start: Start) -> None:
    scene = start(robots.stored(robots.scenario()), None)
    Drag(scene)(5, (0.3, 0.09, 0.1), (0.3, 0.3, 0.1), (0.3, 0.09, 0.1))
    assert scene.refusal == ""
    assert tuple(scene._turn.position) == (1.0, 0.0, 0.0)


def test_a_silent_service_puts_the_mark_back(start: Start) -> None:
    def put(scenario_id: str, body: Scenario, known: StoredScenario, key: str) -> StoredScenario:
        raise Unreachable("nobody answers")

    scene = start(robots.stored(robots.scenario()), put)
    Drag(scene)(5, (0.3, 0.09, 0.1), (0.3, 0.2, 0.1))
    assert "does not answer" in scene.refusal
    assert tuple(scene._marks[5].position) == pytest.approx((0.3, 0.09, 0.1))


@pytest.mark.parametrize("bundled", [False, True])
def test_without_a_key_only_the_dragging_browser_sees_the_contact_move(start: Start, bundled: bool) -> None:
    """The page stores a copy; the scene, which others see, stays as it is."""
    scene = start(robots.stored(robots.scenario(), bundled=bundled), None)
    drag = Drag(scene, headers={KEY_HEADER: "of-somebody"} if bundled else {})
    drag(5, (0.35, 0.09, 0.1), (0.36, 0.12, 0.1), (0.33, 0.19, 0.1))
    assert set(drag.own) == {HELD, f"{HELD}/5", HELD_ENDED}
    for name in (f"{HELD}/5", HELD_ENDED):
        assert tuple(drag.own[name].position) == pytest.approx((0.28, 0.19, 0.1))
    assert tuple(scene._marks[5].position) == pytest.approx((0.3, 0.09, 0.1))
    assert tuple(scene._turn.position) == (0.0, 0.0, 0.0)
    drag(4, (0.3, -0.09, 0.1), (0.3, -0.12, 0.1), (0.3, -0.15, 0.1))
    assert set(drag.own) == {HELD, f"{HELD}/4", HELD_ENDED}, "the frames of the first drag are gone"


def test_a_scene_follows_what_others_store(fake: FakeService, library: ScenePool) -> None:
    scenario = fake.add_scenario()
    first = library.open_scene(Document("scenario", scenario.id))
    changed = robots.scenario()
    changed.phases[0].contacts[0] = changed.phases[0].contacts[0].model_copy(update={"position_m": (0.02, 0.1, 0.0)})
    for k in (1, 2):
        changed.phases[k].contacts[0] = changed.phases[0].contacts[0]
    fake.scenarios[scenario.id] = robots.stored(changed, key=scenario.id)
    assert library.open_scene(Document("scenario", scenario.id)) is first
    assert isinstance(first.live, ScenarioScene)
    assert tuple(first.live._marks[1].position) == pytest.approx((0.02, 0.1, 0.0))
    fake.scenarios[scenario.id] = robots.stored(
        changed.model_copy(update={"terrain": changed.terrain[:3]}), key=scenario.id
    )
    assert library.open_scene(Document("scenario", scenario.id)) is not first


def test_marks_come_and_go_with_the_contacts(start: Start) -> None:
    given = robots.scenario()
    scenario = robots.stored(given)
    scene = start(scenario, lambda scenario_id, body, *_: robots.stored(body, key=scenario_id))
    first = scene._marks[1]
    handles: Any = first._impl.api._handle_from_node_name
    assert set(scene._marks) == {touch.number for touch in placed_contacts(given)} == {1, 2, 3, 4, 5, 6, 7}
    fewer = given.model_copy(update={"phases": [*given.phases[:2], *given.phases[3:5]]})
    stored = robots.stored(fewer, key=scenario.id)
    assert scene.show_source(stored)
    assert tuple(scene._turn.position) == (1.0, 0.0, 0.0)
    assert scene.show_source(stored)
    assert tuple(scene._turn.position) == (1.0, 0.0, 0.0), "what is shown already is no news"
    assert {name for name in handles if name.startswith("/contacts/") and name.count("/") == 2} == {
        f"/contacts/{touch.number}" for touch in placed_contacts(fewer)
    }
    assert scene._marks[1] is first
    for touch in placed_contacts(fewer):
        assert tuple(scene._marks[touch.number].position) == pytest.approx(touch.contact.position_m)
        assert scene._marks[touch.number]._impl.drag_cb
    assert scene.show_source(scenario)
    assert set(scene._marks) == {1, 2, 3, 4, 5, 6, 7}
    assert tuple(scene._marks[7].position) == pytest.approx(placed_contacts(given)[6].contact.position_m)


def test_what_the_page_shapes_has_room_for_what_it_draws(start: Start) -> None:
    """Numbers of vertices that static/js/editor/support_overlay.js relies on, and names of nodes."""
    script = (files("stridelab_web") / "static/js/editor/support_overlay.js").read_text()
    mark: Any = start(robots.stored(robots.scenario()), None)._marks[1]
    handles = mark._impl.api._handle_from_node_name
    assert f"CORNERS = {CORNERS};" in script
    assert len(handles[REGION].vertices) == CORNERS
    assert len(handles[EDGE].vertices) == 2 * CORNERS
    for node in (REGION, EDGE, PLUMB, COM):
        assert node in handles
        assert f'"{node.removeprefix("/support/")}"' in script
    assert f"{COM}/light" in handles


def test_the_robot_stands_where_the_scenario_begins(fake: FakeService, library: ScenePool) -> None:
    opened = library.open_scene(Document("scenario", fake.add_scenario().id))
    handles = opened.server.scene._handle_from_node_name
    whole: Any = handles["/robot"]
    assert whole.visible
    assert (tuple(whole.position), tuple(whole.wxyz)) == ((0, 0, 0), (1, 0, 0, 0))
    for link, pose in zip(robots.LINKS, robots.REFERENCE, strict=True):
        assert (*handles[f"/robot/{link}"].position, *handles[f"/robot/{link}"].wxyz) == pose


def test_the_robot_follows_the_first_footholds(start: Start) -> None:
    given = robots.scenario()
    turned = (math.cos(0.3), 0.0, 0.0, math.sin(0.3))  # 0.6 rad to the left
    left, right = given.phases[0].contacts
    moved = [
        left.model_copy(update={"position_m": (1.0, 2.0, 0.3), "orientation_wxyz": turned}),
        right.model_copy(update={"position_m": (1.2, 1.8, 0.1), "orientation_wxyz": turned}),
    ]
    elsewhere = given.model_copy(update={"phases": [given.phases[0].model_copy(update={"contacts": moved})]})
    place = initial_pose(elsewhere, SIZES)
    assert place is not None
    assert place.position_m == pytest.approx([1.1, 1.9, 0.2])
    assert place.orientation_wxyz == pytest.approx(turned)
    assert initial_pose(given.model_copy(update={"phases": []}), SIZES) is None
    assert initial_pose(given, {}) is None, "a robot without feet stands nowhere"
    scene = start(robots.stored(given), lambda scenario_id, body, *_: robots.stored(body, key=scenario_id))
    Drag(scene)(1, (0.0, 0.09, 0.0), (0.0, 0.13, 0.0))
    assert tuple(scene._robot.position) == pytest.approx((0.0, 0.02, 0.0))


def test_pages_say_what_they_show(fake: FakeService, browse: Callable[..., httpx.Response]) -> None:
    scenario = fake.add_scenario()
    job = fake.add_plan(scenario_id=scenario.id)
    page = browse(f"/view/?plan={job.id}").text
    assert f'data-scene="/view/scene/plan/{job.id}/-"' in page
    assert "right foot touches: 0.00 s to 1.00 s; 1.80 s to 3.00 s; 3.80 s to 5.80 s" in page
    assert f'href="/view/?scenario={scenario.id}"' in page
    del fake.scenarios[scenario.id]
    assert "/view/?scenario=" not in browse(f"/view/?plan={job.id}").text
    scenario = fake.add_scenario()
    running = fake.add_job("plan-motion", "running", scenario_id=scenario.id)
    waiting = browse(f"/view/?plan={running.id}", follow_redirects=False)
    assert waiting.headers["location"] == f"/view/?scenario={scenario.id}&planning={running.id}"
    own = browse(f"/view/?plan={fake.add_job('plan-motion', 'running').id}", follow_redirects=False)
    assert own.headers["location"].endswith("?watch=1"), "without a stored scenario, the page of the plan waits"
    assert browse(f"/view/?plan={fake.add_job('estimate-com', 'succeeded').id}").status_code == 404
    assert browse("/view/?scenario=nothing").status_code == 404
    listed = browse(f"/view/scene/scenario/{fake.add_scenario().id}/-/touches.json").json()
    assert [touch["number"] for touch in listed] == [1, 2, 3, 4, 5, 6, 7]
    assert listed[4] | {"node": "/contacts/5", "phases": [4, 6], "side": "left", "surface": True} == listed[4]
