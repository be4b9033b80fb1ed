"""The websocket between a page and its scene: who may use it, and what passes."""

import asyncio
import json
import socket
import threading
import time
from typing import Any

import pytest
from starlette.types import Message
from viser import _messages

from stridelab_web.scene import proxy
from stridelab_web.scene.proxy import SHARE_MESSAGE
from support.fakes.service import FakeService
from support.fakes.web_app import make_client

PATH = "/view/scene/recording/some/-"


def talk(fake: FakeService, headers: dict[str, str], viewer_url: str | None = None) -> list[Message]:
    """What the web app says to a websocket that only says hello."""
    sentence: list[Message] = []
    scope: dict[str, Any] = {
        "type": "websocket", "path": PATH, "raw_path": PATH.encode(), "query_string": b"",
        "headers": [(k.lower().encode(), v.encode()) for k, v in headers.items()], "subprotocols": ["viser-v1.1.1"],
        "scheme": "ws", "server": ("127.0.0.1", 80), "client": ("127.0.0.1", 1), "root_path": "",
    }  # fmt: skip

    async def receive() -> Message:
        return {"type": "websocket.connect"}

    async def send(message: Message) -> None:
        sentence.append(message)

    asyncio.run(make_client(fake, viewer_url=viewer_url).app(scope, receive, send))
    return sentence


def test_a_foreign_page_is_closed_out(fake: FakeService) -> None:
    sentence = talk(fake, {"Host": "127.0.0.1", "Origin": "https://elsewhere.example"})
    assert [(m["type"], m["code"]) for m in sentence] == [("websocket.close", 4403)]


@pytest.mark.parametrize("viewer_url", [None, "http://127.0.0.1:9"])
def test_without_a_viewer_the_socket_closes_and_the_page_says_why(
    fake: FakeService, viewer_url: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(proxy, "STARTING_RETRIES", 0)
    sentence = talk(fake, {"Host": "127.0.0.1", "Origin": "http://127.0.0.1"}, viewer_url)
    assert [(m["type"], m.get("code")) for m in sentence] == [("websocket.accept", None), ("websocket.close", 1013)]
    recording = fake.add_recording()
    answer = make_client(fake, viewer_url=viewer_url).request("POST", f"/view/scene/recording/{recording.id}/-/open")
    assert answer.status_code == 503
    assert "viewer" in answer.json()["detail"]


def test_a_viewer_that_is_still_starting_is_waited_for(fake: FakeService) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
    body = b'{"port": 1, "secret": "s", "said": "no"}'
    answered = b"HTTP/1.1 200 OK\r\nContent-Length: %d\r\n\r\n%b" % (len(body), body)

    def start_late() -> None:
        time.sleep(0.3)
        with socket.create_server(("127.0.0.1", port)) as server, server.accept()[0] as caller:
            caller.recv(65536)
            caller.sendall(answered)

    late = threading.Thread(target=start_late)
    late.start()
    viewer_url = f"http://127.0.0.1:{port}"
    answer = make_client(fake, viewer_url=viewer_url).request("POST", "/view/scene/recording/some/-/open")
    late.join()
    assert answer.json() == {"ready": True, "said": "no"}


def test_share_requests_are_known_by_the_name_that_viser_gives_them() -> None:
    assert SHARE_MESSAGE in _messages.ShareUrlRequest.__name__.encode()
    assert SHARE_MESSAGE in _messages.ShareUrlDisconnect.__name__.encode()


@pytest.mark.parametrize(
    ("answered", "status"),
    [
        ((429, "scene-limit"), 429),
        ((503, "scenes-full"), 503),
        ((404, "recording-not-found"), 404),
        ((400, "odd"), 503),
    ],
)
def test_a_refusal_of_the_viewer_is_a_problem_with_its_code(
    fake: FakeService, answered: tuple[int, str], status: int
) -> None:
    request: list[bytes] = []
    with socket.create_server(("127.0.0.1", 0)) as server:

        def refuse() -> None:
            with server.accept()[0] as caller:
                _, _, sent = caller.recv(65536).partition(b"\r\n\r\n")
                while not sent.endswith(b"}"):
                    sent += caller.recv(65536)
                request.append(sent)
                body = json.dumps({"code": answered[1], "detail": "What to do."}).encode()
                caller.sendall(b"HTTP/1.1 %d No\r\nContent-Length: %d\r\n\r\n%b" % (answered[0], len(body), body))

        viewer = threading.Thread(target=refuse)
        viewer.start()
        caller = make_client(fake, viewer_url=f"http://127.0.0.1:{server.getsockname()[1]}", user_of=lambda _: "änn")
        answer = caller.request("POST", "/view/scene/recording/some/-/open")
        viewer.join()
    assert (answer.status_code, answer.headers["content-type"]) == (status, "application/problem+json")
    problem = answer.json()
    assert (problem["status"], problem["code"], problem["detail"]) == (status, answered[1], "What to do.")
    assert json.loads(request[0])["user"] == "änn"
