"""The pages, the viewer and the fake interface, listening: what a browser needs to look at a plan within seconds."""

import contextlib
import os
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass

import httpx
import uvicorn
from starlette.types import Receive, Scope, Send

from stridelab.service.api.middleware.request_context import RequestContextMiddleware
from stridelab_web.app import create_web
from stridelab_web.config import WebConfig
from support.fakes.service import FakeService
from support.fakes.web_app import anybody

STARTED_WITHIN_S = 180.0


@dataclass(frozen=True)
class Lab:
    """Where it listens, and what it shows."""

    url: str
    fake: FakeService


@contextlib.contextmanager
def running_lab() -> Iterator[Lab]:
    """A lab on free loopback ports, behind the security headers of the real one."""
    fake = FakeService(step_s=0.3)
    port, viewer_port = _free_port(), _free_port()
    url, viewer_url = f"http://127.0.0.1:{port}", f"http://127.0.0.1:{viewer_port}"
    interface = fake.app()
    transport = httpx.ASGITransport(interface)
    pages = create_web(WebConfig(url, "0.1.0", transport=transport, viewer_url=viewer_url, scenario_right=anybody))

    async def front(scope: Scope, receive: Receive, send: Send) -> None:
        await (interface if scope["path"].startswith("/api/") else pages)(scope, receive, send)

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
        yield Lab(url, fake)
    finally:
        viewer.terminate()
        viewer.wait(20)
        server.should_exit = True
        thread.join(20)


def _free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        return int(taken.getsockname()[1])


def _wait_for(url: str, process: subprocess.Popen[bytes]) -> None:
    deadline = time.monotonic() + STARTED_WITHIN_S
    while process.poll() is None and time.monotonic() < deadline:
        with contextlib.suppress(httpx.TransportError):
            if httpx.get(url, trust_env=False).status_code == 200:
                return
        time.sleep(0.1)
    raise RuntimeError("the viewer did not start")
