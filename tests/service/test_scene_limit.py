"""Each user has a limit of open scenes, counted over the real way from the browser to the viewer."""

import time
from collections.abc import Iterator
from contextlib import ExitStack

import httpx
import pytest
import viser
import websockets
from websockets.sync.client import ClientConnection, connect

from support.browser.service_costs import Lab, viewer_lab
from support.robots.scenario_bodies import one_step
from support.service.database import TestDatabases
from support.service.web_server import refusal_code

PER_USER = 2


@pytest.fixture(scope="module")
def lab(postgres: TestDatabases, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Lab]:
    limits = {"STRIDELAB_USER_SCENES": str(PER_USER), "STRIDELAB_VIEWER_SCENES": "9"}
    with viewer_lab(postgres, tmp_path_factory.mktemp("data"), **limits) as running:
        yield running


def scene_of(lab: Lab) -> str:
    answer = lab.admin.post("/api/v1/scenarios", json=one_step())
    assert answer.status_code == 201, answer.text
    return f"/view/scene/scenario/{answer.json()['id']}/-"


def browser(lab: Lab, secret: str, scene: str) -> ClientConnection:
    """The websocket of a browser that has the scene open."""
    websocket = connect(
        lab.served.base_url.replace("http", "ws") + scene,
        subprotocols=[websockets.Subprotocol(f"viser-v{viser.__version__}")],
        additional_headers={"Authorization": f"Bearer {secret}"},
        max_size=None,
        proxy=None,
    )
    websocket.recv(120)
    return websocket


def test_a_user_at_the_limit_of_scenes_is_refused_with_advice_to_close_one(lab: Lab) -> None:
    ann, bob = (lab.token(name, "submit")["secret"] for name in ("ann", "bob"))
    scenes = [scene_of(lab) for _ in range(PER_USER + 1)]

    def opened(secret: str, scene: str) -> httpx.Response:
        with lab.http(secret) as http:
            return http.post(f"{scene}/open", timeout=120)

    with ExitStack() as open_browsers:
        first, *_ = [open_browsers.enter_context(browser(lab, ann, scene)) for scene in scenes[:PER_USER]]
        refused = opened(ann, scenes[-1])
        assert refusal_code(refused) == (429, "scene-limit")
        assert refused.headers["content-type"] == "application/problem+json"
        assert "Close one of those tabs" in refused.json()["detail"]
        with pytest.raises(websockets.ConnectionClosed) as closed:
            browser(lab, ann, scenes[-1])
        assert closed.value.rcvd is not None
        assert (closed.value.rcvd.code, closed.value.rcvd.reason) == (1013, "scene-limit")
        assert opened(ann, scenes[0]).status_code == 200, "what is open stays open"
        assert opened(bob, scenes[-1]).status_code == 200, "another user has a limit of his own"
        first.ping().wait(10)
        first.close()
        answer, ends_s = opened(ann, scenes[-1]), time.monotonic() + 60.0
        while answer.status_code == 429 and time.monotonic() < ends_s:  # the viewer may notice later that it went
            time.sleep(0.1)
            answer = opened(ann, scenes[-1])
        assert answer.json() == {"ready": True, "said": ""}
