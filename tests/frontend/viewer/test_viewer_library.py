"""Scenes are opened once, rebuilt when their recording changes, and closed without viewers; they have limits."""

import socket
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any
from urllib.parse import quote

import httpx
import pytest
import viser
import websockets
from websockets.sync.client import connect

from stridelab.client import ProblemError
from stridelab.translations.catalogue import LANGUAGES
from stridelab_web.parquet import read_columns
from stridelab_web.scene.documents import USER_HEADER, Document, DocumentKind
from stridelab_web.scene.recording_frames import build_frames
from stridelab_web.viewer import scene_pool as module
from stridelab_web.viewer.access_guard import users_of
from stridelab_web.viewer.control import create_control
from stridelab_web.viewer.scene_builders import Kind, Live, document_kinds
from stridelab_web.viewer.scene_limits import (
    MAX_SCENES,
    MIN_SCENES,
    USER_SCENES,
    SceneLimits,
    ScenesInUse,
    limits_of,
    memory_bytes,
    scenes_that_fit,
)
from stridelab_web.viewer.scene_pool import OpenScene, ScenePool
from support.fakes.service import FakeService
from support.fakes.web_app import Caller


class Shelf:
    """A library over the fake interface, with a clock that a test moves."""

    def __init__(self, fake: FakeService, limits: SceneLimits) -> None:
        self.fake = fake
        self.now_s = 0.0
        self.built: list[Document] = []
        real = document_kinds(fake.client(), lambda _: fake.client())
        watched: dict[DocumentKind, Kind] = {name: self.watch(kind) for name, kind in real.items()}
        self.library = ScenePool(watched, limits, clock=lambda: self.now_s)

    def watch(self, kind: Kind) -> Kind:
        def build(server: viser.ViserServer, document: Document, source: Any) -> Live | None:
            self.built.append(document)
            return kind.build(server, document, source)

        return Kind(kind.look_up, build)


def of(recording_id: str, job_id: str | None = None) -> Document:
    return Document("recording", recording_id, job_id)


@pytest.fixture
def shelf(fake: FakeService):  # type: ignore[no-untyped-def]
    made = Shelf(fake, SceneLimits(8))
    yield made
    made.library.close_all()


def test_a_scene_holds_every_node_that_the_page_moves(shelf: Shelf) -> None:
    recording = shelf.fake.add_recording()
    job = shelf.fake.add_job(state="succeeded", recording_id=recording.id)
    opened = shelf.library.open_scene(of(recording.id, job.id))
    frames = build_frames(recording, read_columns(shelf.fake.tracks), read_columns(shelf.fake.com))
    names = set(opened.server.scene._handle_from_node_name)
    moved = {p.name for p in frames.points} | {s.name for s in frames.sticks}
    moved |= {name for a in frames.arrows for name in (a.shaft, a.head)}
    moved |= {e.name for e in frames.ellipsoids}
    assert moved | set(frames.to_layout()["still"]) <= names
    assert {"/floor", "/plates/1", "/plates/2/label", "/com/fused", "/com/band", "/axis/line"} <= names


def test_each_language_has_a_scene_with_its_own_labels(shelf: Shelf) -> None:
    recording = shelf.fake.add_recording()
    document = of(recording.id)
    texts = {}
    for language in LANGUAGES:
        scene = shelf.library.open_scene(replace(document, language=language)).server.scene
        label: Any = scene._handle_from_node_name["/plates/1/label"]
        texts[language] = label.text
    assert texts == {"en": "Plate 1", "de": "Platte 1", "fr": "Plateforme 1", "ja": "プレート 1"}


def test_opening_again_reuses_the_scene_until_the_recording_changes(shelf: Shelf) -> None:
    recording = shelf.fake.add_recording()
    document = of(recording.id)
    first = shelf.library.open_scene(document)
    assert shelf.library.open_scene(document) is first
    shelf.fake.recordings[recording.id] = recording.model_copy(update={"windows_s": [(0.1, 0.2)]})
    second = shelf.library.open_scene(document)
    assert second is not first
    assert second.secret != first.secret
    assert shelf.built == [document, document]
    assert len(shelf.library) == 1


@contextmanager
def limited(fake: FakeService, total: int, per_user: int = 0) -> Iterator[Shelf]:
    made = Shelf(fake, SceneLimits(total, per_user))
    try:
        yield made
    finally:
        made.library.close_all()


@contextmanager
def watching(opened: OpenScene, user: str = "") -> Iterator[None]:
    """A browser of ``user`` that has the scene open."""
    with connect(
        f"ws://127.0.0.1:{opened.port}/{opened.secret}",
        subprotocols=[websockets.Subprotocol(f"viser-v{viser.__version__}")],
        additional_headers={USER_HEADER: quote(user)},
        max_size=None,
        proxy=None,
    ) as browser:
        browser.recv()
        yield
    deadline = time.monotonic() + 10.0
    while user in users_of(opened.server) and time.monotonic() < deadline:
        time.sleep(0.01)


def is_open(opened: OpenScene) -> bool:
    """Whether the scene's server still takes connections."""
    try:
        with socket.create_connection(("127.0.0.1", opened.port), timeout=10.0) as probe:
            probe.shutdown(socket.SHUT_WR)
            with suppress(ConnectionResetError):
                probe.recv(1)  # the server has closed its end: a scene that is closed later leaves none open
    except ConnectionRefusedError:
        return False
    return True


def test_the_scene_that_was_idle_for_longest_makes_room(fake: FakeService) -> None:
    documents = [of(fake.add_recording().id) for _ in range(3)]
    with limited(fake, total=2) as shelf:
        opened = {}
        for k in (0, 1, 0, 2):
            opened[k] = shelf.library.open_scene(documents[k])
            shelf.now_s += module.COMING_S
        assert [is_open(opened[k]) for k in range(3)] == [True, False, True]
        assert shelf.built == documents
        assert len(shelf.library) == 2


def test_a_scene_that_somebody_watches_is_never_closed(fake: FakeService) -> None:
    documents = [of(fake.add_recording().id) for _ in range(3)]
    with limited(fake, total=2) as shelf:
        watched = shelf.library.open_scene(documents[0])
        with watching(watched):
            shelf.now_s = 10 * module.IDLE_S
            idle = shelf.library.open_scene(documents[1])
            shelf.now_s += module.COMING_S
            shelf.library.open_scene(documents[2])
            assert is_open(watched)
            assert not is_open(idle)
            shelf.now_s += 2 * module.IDLE_S
            shelf.library.close_idle()
            assert is_open(watched)
            assert len(shelf.library) == 1
        shelf.now_s += module.IDLE_S
        shelf.library.close_idle()
        assert len(shelf.library) == 1, "counted from when the browser has gone"
        shelf.now_s += 1
        shelf.library.close_idle()
        assert not is_open(watched)


def test_where_all_scenes_are_watched_another_is_refused_with_what_to_do(fake: FakeService) -> None:
    documents = [of(fake.add_recording().id) for _ in range(3)]
    with limited(fake, total=2) as shelf:
        first, second = (shelf.library.open_scene(document, "ann") for document in documents[:2])
        with watching(first, "ann"), watching(second, "ann"):
            shelf.now_s += module.COMING_S
            with pytest.raises(ScenesInUse, match="Close a tab") as full:
                shelf.library.open_scene(documents[2], "bob")
            assert (full.value.status, full.value.code) == (503, "scenes-full")
            assert shelf.library.open_scene(documents[0], "bob") is first, "what is open needs no room"
            assert shelf.built == documents[:2]
        shelf.now_s += module.COMING_S
        shelf.library.open_scene(documents[2], "bob")
        assert len(shelf.library) == 2


def test_a_scene_whose_browser_is_about_to_come_is_not_closed(fake: FakeService) -> None:
    documents = [of(fake.add_recording().id) for _ in range(2)]
    with limited(fake, total=1) as shelf:
        coming = shelf.library.open_scene(documents[0])
        shelf.now_s = module.COMING_S - 1
        with pytest.raises(ScenesInUse):
            shelf.library.open_scene(documents[1])
        with watching(coming):
            pass
        shelf.now_s += module.CONNECTING_S
        shelf.library.open_scene(documents[1])
        assert not is_open(coming), "its browser came and went"


def test_a_user_at_the_limit_loses_the_own_idle_scene_and_no_other(fake: FakeService) -> None:
    documents = [of(fake.add_recording().id) for _ in range(5)]
    with limited(fake, total=9, per_user=2) as shelf:
        theirs = shelf.library.open_scene(documents[0], "bob")
        shared, own = (shelf.library.open_scene(document, "ann") for document in documents[1:3])
        shelf.library.open_scene(documents[1], "bob")
        shelf.now_s += module.COMING_S
        with watching(own, "ann"):
            shelf.library.open_scene(documents[3], "ann")
            assert [is_open(scene) for scene in (theirs, shared, own)] == [True, True, True]
            shelf.now_s += module.COMING_S
            newest = shelf.library.open_scene(documents[4], "ann")
            assert len(shelf.library) == 4, "the one that only ann had open is closed"
            with watching(newest, "ann"), pytest.raises(ScenesInUse, match="limit for one user") as refused:
                shelf.library.open_scene(documents[3], "ann")
            assert (refused.value.status, refused.value.code) == (429, "scene-limit")
            shelf.library.open_scene(documents[3], "bob")
            shelf.library.open_scene(documents[2], "ann")


def test_without_a_login_only_the_total_counts(fake: FakeService) -> None:
    with limited(fake, total=3, per_user=1) as shelf:
        opened = [shelf.library.open_scene(of(fake.add_recording().id)) for _ in range(3)]
        assert all(is_open(scene) for scene in opened)


def test_scenes_that_are_opened_at_once_stay_within_the_limit(fake: FakeService) -> None:
    documents = [of(fake.add_recording().id) for _ in range(12)]
    with limited(fake, total=5) as shelf, ThreadPoolExecutor(12) as threads:

        def attempt(document: Document) -> bool:
            try:
                return is_open(shelf.library.open_scene(document))
            except ScenesInUse:
                return False

        assert sum(threads.map(attempt, documents)) == 5
        assert len(shelf.library) == 5


def test_fifty_scenes_fit_and_leave_no_thread_behind(fake: FakeService) -> None:
    documents = [of(fake.add_recording().id) for _ in range(50)]
    threads = threading.active_count()
    with limited(fake, total=50) as shelf:
        opened = [shelf.library.open_scene(document) for document in documents]
        assert all(is_open(scene) for scene in opened)
        assert threading.active_count() >= threads + 50
        shelf.now_s = module.IDLE_S + 1
        shelf.library.close_idle()
        assert len(shelf.library) == 0
    assert threading.active_count() < threads + 5


def test_a_scene_that_fails_takes_no_place(fake: FakeService) -> None:
    with limited(fake, total=1) as shelf:
        fake.robot_refusal = (503, "robot-data-missing", "Its data is missing.")
        scenario = Document("scenario", fake.add_scenario().id)
        for _ in range(3):
            with pytest.raises(ProblemError):
                shelf.library.open_scene(scenario)
        assert is_open(shelf.library.open_scene(of(fake.add_recording().id)))


def test_idle_scenes_are_closed(shelf: Shelf) -> None:
    document = of(shelf.fake.add_recording().id)
    shelf.library.open_scene(document)
    shelf.now_s = module.IDLE_S - 1
    shelf.library.close_idle()
    assert len(shelf.library) == 1
    shelf.now_s = module.IDLE_S + 1
    shelf.library.close_idle()
    assert len(shelf.library) == 0


def control(shelf: Shelf, token: str | None = None) -> Caller:
    return Caller(create_control(shelf.library, token))


def wanted(recording_id: str) -> dict[str, str | None]:
    return {"kind": "recording", "id": recording_id, "job_id": None}


def test_control_opens_scenes_for_the_web_app_only(shelf: Shelf) -> None:
    body = wanted(shelf.fake.add_recording().id)
    calls = control(shelf)
    answer = calls.request("POST", "/scenes", json=body, headers={"Host": "127.0.0.1:1"})
    assert answer.status_code == 200
    assert set(answer.json()) == {"port", "secret", "said"}
    for headers in ({"Origin": "http://127.0.0.1:8000", "Host": "127.0.0.1:1"}, {"Host": "evil.example:1"}):
        assert calls.request("POST", "/scenes", json=body, headers=headers).status_code == 403
    assert calls.get("/health", headers={"Host": "127.0.0.1:1"}).json() == {"status": "ok", "scenes": 1}


def test_control_asks_for_the_token_of_the_service(shelf: Shelf) -> None:
    body = wanted(shelf.fake.add_recording().id)
    calls = control(shelf, "secret")
    host = {"Host": "127.0.0.1:1"}
    assert calls.request("POST", "/scenes", json=body, headers=host).status_code == 403
    headers = {**host, "Authorization": "Bearer secret"}
    assert calls.request("POST", "/scenes", json=body, headers=headers).status_code == 200


def test_control_passes_refusals_on(shelf: Shelf) -> None:
    answer: httpx.Response = control(shelf).request(
        "POST", "/scenes", json=wanted("nothing"), headers={"Host": "127.0.0.1:1"}
    )
    assert answer.status_code == 404
    assert answer.json()["code"] == "recording-not-found"


def test_control_knows_no_other_kinds(shelf: Shelf) -> None:
    body = {"kind": "film", "id": "x", "job_id": None}
    answer = control(shelf).request("POST", "/scenes", json=body, headers={"Host": "127.0.0.1:1"})
    assert answer.status_code == 404


def test_control_says_which_limit_is_met(fake: FakeService) -> None:
    documents = [wanted(fake.add_recording().id) for _ in range(2)]
    with limited(fake, total=9, per_user=1) as shelf:
        answers = [
            control(shelf).request("POST", "/scenes", json={**document, "user": "ann"}, headers={"Host": "127.0.0.1:1"})
            for document in documents
        ]
    assert [answer.status_code for answer in answers] == [200, 429]
    assert answers[1].json()["code"] == "scene-limit"
    assert "Close one of those tabs" in answers[1].json()["detail"]


@pytest.mark.parametrize(
    ("memory_gb", "files", "scenes"), [(0.2, 4096, 8), (8.0, 4096, 68), (8.0, 256, 26), (512.0, 4096, 200), (8.0, 0, 8)]
)
def test_the_number_of_scenes_comes_from_memory_and_open_files(memory_gb: float, files: int, scenes: int) -> None:
    assert scenes_that_fit(memory_gb * 2**30, files) == scenes


def test_the_memory_of_a_control_group_counts(tmp_path: Path) -> None:
    groups, own = tmp_path / "cgroup", tmp_path / "own"
    (groups / "lab" / "viewer").mkdir(parents=True)
    own.write_text("0::/lab/viewer\n")
    machine = memory_bytes(groups, tmp_path / "none")
    (groups / "lab" / "viewer" / "memory.max").write_text("max\n")
    assert memory_bytes(groups, own) == machine
    (groups / "lab" / "memory.max").write_text("1048576\n")
    assert memory_bytes(groups, own) == 1048576
    (groups / "memory" / "old").mkdir(parents=True)
    (groups / "memory" / "old" / "memory.limit_in_bytes").write_text("2097152\n")
    own.write_text("4:memory:/old\n3:cpu:/lab\n")
    assert memory_bytes(groups, own) == 2097152


def test_the_limits_come_from_the_settings() -> None:
    given = {"STRIDELAB_VIEWER_SCENES": "50", "STRIDELAB_USER_SCENES": "0"}
    assert limits_of(given) == SceneLimits(50, 0)
    assert limits_of({}).per_user == USER_SCENES
    assert MIN_SCENES <= limits_of({}).total <= MAX_SCENES
    for wrong in ({"STRIDELAB_VIEWER_SCENES": "0"}, {"STRIDELAB_USER_SCENES": "-1"}, {"STRIDELAB_USER_SCENES": "many"}):
        with pytest.raises(ValueError, match=r"STRIDELAB|invalid literal"):
            limits_of(wrong)
