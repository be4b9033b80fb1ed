"""The web app on the fake interface: called without a network, or listening, with a viewer, for a browser."""

import asyncio
import contextlib
import os
import re
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import httpx
import uvicorn
from starlette.types import ASGIApp, Receive, Scope, Send

from stridelab.service.api.middleware.request_context import RequestContextMiddleware
from stridelab_web.app import create_web
from stridelab_web.config import ANONYMOUS_KEY, ScenarioRight, WebConfig
from support.fakes.service import FakeService


def anybody(scope: Scope, scenario_id: str, owner: str | None) -> ScenarioRight:
    """Rights of a service without tokens: every caller may change everything."""
    return ScenarioRight(ANONYMOUS_KEY)


@dataclass(frozen=True)
class Caller:
    """Calls an ASGI app, one event loop per call; redirects are answers."""

    app: ASGIApp

    def request(self, method: str, address: str, **options: Any) -> httpx.Response:
        async def call() -> httpx.Response:
            transport = httpx.ASGITransport(app=self.app)
            async with httpx.AsyncClient(transport=transport, base_url="http://127.0.0.1") as client:
                return without_line_breaks(await client.request(method, address, **options))

        return asyncio.run(call())

    def get(self, address: str, **options: Any) -> httpx.Response:
        return self.request("GET", address, **options)


def without_line_breaks(answer: httpx.Response) -> httpx.Response:
    """A page as browsers show it: line breaks in the templates are one space, or nothing between two tags."""
    if not answer.headers.get("content-type", "").startswith("text/html") or re.search(
        "<pre|/static/viser/", answer.text
    ):
        return answer
    text = re.sub(r"\s*\n\s*|  +", " ", re.sub(r">\s*\n\s*<", "><", answer.text))
    headers = [(name, value) for name, value in answer.headers.multi_items() if name != "content-encoding"]
    return httpx.Response(answer.status_code, headers=headers, text=text, request=answer.request)


def make_client(fake: FakeService, **config: Any) -> Caller:
    """A caller of the web app over ``fake``."""
    arguments: dict[str, Any] = {"scenario_right": anybody, "transport": httpx.ASGITransport(app=fake.app()), **config}
    return Caller(create_web(WebConfig("http://127.0.0.1", "0.1.0", **arguments)))


STARTED_WITHIN_S = 180.0


@dataclass(frozen=True)
class Lab:
    """Addresses of a running web app, and the fake service behind it."""

    url: str
    fake: FakeService


@contextlib.contextmanager
def running_labs() -> Iterator[Callable[[], Lab]]:
    """Free loopback ports, behind the security headers of the real service; each call puts a new, empty lab there.

    The viewer is the same for all: it takes 1.3 s of processor time to start.
    """
    port, viewer_port = _free_port(), _free_port()
    url, viewer_url = f"http://127.0.0.1:{port}", f"http://127.0.0.1:{viewer_port}"
    current: dict[str, ASGIApp] = {}

    def put_new_lab() -> Lab:
        fake = FakeService(step_s=0.3)
        interface = fake.app()
        transport = httpx.ASGITransport(interface)
        pages = create_web(WebConfig(url, "0.1.0", transport=transport, viewer_url=viewer_url, scenario_right=anybody))
        current.update(interface=interface, pages=pages)
        return Lab(url, fake)

    async def front(scope: Scope, receive: Receive, send: Send) -> None:
        await current["interface" if scope["path"].startswith("/api/") else "pages"](scope, receive, send)

    config = uvicorn.Config(
        RequestContextMiddleware(front), port=port, log_level="warning", lifespan="off", ws="websockets-sansio"
    )
    server = uvicorn.Server(config)
    thread = threading.Thread(target=server.run, daemon=True)
    environment = {**os.environ, "STRIDELAB_PORT": str(port), "STRIDELAB_VIEWER_URL": viewer_url}
    viewer = subprocess.Popen([sys.executable, "-m", "stridelab_web.viewer"], env=environment)
    thread.start()
    try:
        _wait_for(f"{viewer_url}/health", viewer)
        yield put_new_lab
    finally:
        viewer.terminate()
        viewer.wait(20)
        server.should_exit = True
        thread.join(20)


def _free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as reserved:
        return int(reserved.getsockname()[1])


def _wait_for(url: str, process: subprocess.Popen[bytes]) -> None:
    deadline = time.monotonic() + STARTED_WITHIN_S
    while process.poll() is None and time.monotonic() < deadline:
        with contextlib.suppress(httpx.TransportError):
            if httpx.get(url, trust_env=False).status_code == 200:
                return
        time.sleep(0.1)
    raise RuntimeError("the viewer did not start")
