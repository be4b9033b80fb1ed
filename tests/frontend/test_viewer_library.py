"""Scenes are opened once, rebuilt when their recording changes, and closed when nobody looks."""

from typing import Any

import httpx
import pytest
import viser

from stridelab_web.documents import Document, DocumentKind
from stridelab_web.recording_frames import build_frames
from stridelab_web.tables import read_columns
from stridelab_web.viewer import library as module
from stridelab_web.viewer.control import create_control
from stridelab_web.viewer.kinds import Kind, Live, kinds
from stridelab_web.viewer.library import Library
from support.fake_service import FakeService
from support.web import Caller


class Shelf:
    """A library over the fake interface, with a clock that a test moves."""

    def __init__(self, fake: FakeService) -> None:
        self.fake = fake
        self.now_s = 0.0
        self.built: list[Document] = []
        real = kinds(fake.client(), lambda _: fake.client())
        watched: dict[DocumentKind, Kind] = {name: self.watch(kind) for name, kind in real.items()}
        self.library = Library(watched, clock=lambda: self.now_s)

    def watch(self, kind: Kind) -> Kind:
        def build(server: viser.ViserServer, document: Document, source: Any) -> Live | None:
            self.built.append(document)
            return kind.build(server, document, source)

        return Kind(kind.look_up, build)


def of(recording_id: str, job_id: str | None = None) -> Document:
    return Document("recording", recording_id, job_id)


@pytest.fixture
def shelf(fake: FakeService):  # type: ignore[no-untyped-def]
    made = Shelf(fake)
    yield made
    made.library.close()


def test_a_scene_holds_every_node_that_the_page_moves(shelf: Shelf) -> None:
    recording = shelf.fake.add_recording()
    job = shelf.fake.add_job(state="succeeded", recording_id=recording.id)
    opened = shelf.library.open(of(recording.id, job.id))
    frames = build_frames(recording, read_columns(shelf.fake.tracks), read_columns(shelf.fake.com))
    names = set(opened.server.scene._handle_from_node_name)
    moved = {p.name for p in frames.points} | {s.name for s in frames.sticks}
    moved |= {name for a in frames.arrows for name in (a.shaft, a.head)}
    moved |= {e.name for e in frames.ellipsoids}
    assert moved | set(frames.layout()["still"]) <= names
    assert {"/floor", "/plates/1", "/plates/2/label", "/com/fused", "/com/band", "/axis/line"} <= names


def test_opening_again_reuses_the_scene_until_the_recording_changes(shelf: Shelf) -> None:
    recording = shelf.fake.add_recording()
    document = of(recording.id)
    first = shelf.library.open(document)
    assert shelf.library.open(document) is first
    shelf.fake.recordings[recording.id] = recording.model_copy(update={"windows_s": [(0.1, 0.2)]})
    second = shelf.library.open(document)
    assert second is not first
    assert second.secret != first.secret
    assert shelf.built == [document, document]
    assert len(shelf.library) == 1


def test_the_least_used_scene_is_closed_first(shelf: Shelf, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "SCENES_AT_MOST", 2)
    documents = [of(shelf.fake.add_recording().id) for _ in range(3)]
    shelf.library.open(documents[0])
    shelf.library.open(documents[1])
    shelf.library.open(documents[0])
    shelf.library.open(documents[2])
    shelf.library.open(documents[0])
    assert shelf.built == documents
    assert len(shelf.library) == 2


def test_idle_scenes_are_closed(shelf: Shelf) -> None:
    document = of(shelf.fake.add_recording().id)
    shelf.library.open(document)
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
