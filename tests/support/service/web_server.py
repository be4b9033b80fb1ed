"""The web application on a real port, in a thread of the test process, and its answers.

Its pool of processes imports with the first task and leaves its fork server to the next pool: imports cost a second or
two. ``python -m support.service.web_server`` is the web server as a program.
"""

import asyncio
import atexit
import os
import socket
import ssl
import subprocess
import sys
import threading
from collections.abc import Awaitable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, TypeVar
from unittest import mock

import httpx
import structlog
import uvicorn
from fastapi import FastAPI

from stridelab.service.api import app as api_app
from stridelab.service.api import server as api_server
from stridelab.service.api.app import create_app
from stridelab.service.api.dependencies import Parts
from stridelab.service.processes.fork_server_client import ForkServerClient, child_environment
from stridelab.service.processes.pool import IsolatedPool
from stridelab.service.settings import Settings

Key = tuple[tuple[str, ...], frozenset[tuple[str, str]]]
"""What a fork server has imported, and its environment."""
_starter: Final = ThreadPoolExecutor(1)
"""The kernel kills a fork server when the thread that started it ends: this one lives as long as the tests."""


class Server(asyncio.subprocess.Process):
    """A fork server, which may outlive its client and the client's event loop."""

    def __init__(self, key: Key) -> None:
        modules, environment = key
        self.key, self.last_serial = key, 0
        self.control, theirs = socket.socketpair()
        command = [sys.executable, "-m", "stridelab.service.processes.fork_server", str(os.getpid()), ",".join(modules)]
        options: dict[str, Any] = {"stdin": theirs, "stdout": subprocess.DEVNULL, "start_new_session": True}
        with theirs:
            self.process = _starter.submit(subprocess.Popen, command, env=dict(environment), **options).result()
        self.control.setblocking(False)
        self.pid = self.process.pid

    def kill(self) -> None:
        self.process.kill()

    async def wait(self) -> int:
        return self.process.wait()


_idle: Final[dict[Key, Server]] = {}


@atexit.register
def _end_idle() -> None:
    for server in _idle.values():
        server.control.close()
        server.kill()
        server.process.wait()


class Lent(ForkServerClient):
    """A client that returns its fork server for the next one, if no child of it is left."""

    def __init__(self, server: Server) -> None:
        super().__init__(server, server.control)
        self._server, self._serial = server, server.last_serial

    @staticmethod
    def start_lent(preload: Sequence[str]) -> "Lent":
        """A fork server that another client has returned, or else a new one."""
        environment = child_environment()
        environment.pop("PYTEST_CURRENT_TEST", None)
        key = tuple(preload), frozenset(environment.items())
        idle = _idle.pop(key, None)
        return Lent(idle if idle is not None and idle.process.poll() is None else Server(key))

    async def close(self) -> None:
        if self._is_gone or self._children or self._receive_buffer or self._server.key in _idle:
            await super().close()
            return
        self._is_gone = True
        self._ping_task.cancel()
        self._loop.remove_reader(self._control)
        self._server.last_serial = self._serial
        _idle[self._server.key] = self._server


class LatePool(IsolatedPool):
    """Starts with its first task what the service starts with itself."""

    async def __aenter__(self) -> "LatePool":  # noqa: PYI034 (as its parent)
        return self

    async def _running_fork_server(self) -> ForkServerClient:
        async with self._starting:
            if self._fork_server is not None and self._fork_server.is_gone:
                await self.close()
            if self._fork_server is None:
                self._fork_server = Lent.start_lent(self._preload)
            return self._fork_server


T = TypeVar("T")
NO_CERTIFICATES = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
"""Addresses are plain ones; each client would read all the world's certificates, in 40 ms."""


@dataclass(frozen=True)
class Served:
    """A running application."""

    app: FastAPI
    base_url: str
    loop: asyncio.AbstractEventLoop
    data: Path

    @property
    def parts(self) -> Parts:
        parts = self.app.state.parts
        assert isinstance(parts, Parts)
        return parts

    def http(self, **options: Any) -> httpx.Client:
        return httpx.Client(**{"base_url": self.base_url, "timeout": 30.0, "verify": NO_CERTIFICATES, **options})

    def run(self, work: Awaitable[T], timeout_s: float = 30.0) -> T:
        """Do ``work`` in the application's own event loop."""

        async def wrapped() -> T:
            return await work

        return asyncio.run_coroutine_threadsafe(wrapped(), self.loop).result(timeout_s)

    def stored_files(self) -> set[str]:
        """Keys of all stored files, and what lies in the spool."""
        blobs = self.data / "blobs"
        paths = {str(path.relative_to(blobs)) for path in blobs.rglob("*") if path.is_file()}
        return paths | {f"spool/{path.name}" for path in (self.data / "spool").glob("*/files/*")}


@contextmanager
def served(database_url: str, data: Path, **options: Any) -> Iterator[Served]:
    """Run the application with ``options`` as settings; stopped at the end."""
    settings = Settings(
        **{"database_url": database_url, "data_dir": data, "min_free_disk_mb": 0, "job_niceness": 0, **options}
    )
    app = create_app(settings)
    structlog.configure(
        logger_factory=structlog.stdlib.LoggerFactory(), processors=[structlog.processors.KeyValueRenderer()]
    )
    server = uvicorn.Server(
        uvicorn.Config(app, host="127.0.0.1", port=0, log_config=None, access_log=False, timeout_graceful_shutdown=1)
    )
    started = threading.Event()
    loops: list[asyncio.AbstractEventLoop] = []

    async def serve() -> None:
        loops.append(asyncio.get_running_loop())
        task = asyncio.create_task(server.serve())
        while not server.started and not task.done():
            await asyncio.sleep(0.01)
        started.set()
        await task

    thread = threading.Thread(target=lambda: asyncio.run(serve()), daemon=True)
    with mock.patch("stridelab.service.api.app.IsolatedPool", LatePool):
        thread.start()
        assert started.wait(60)
    assert server.started, "the application did not start; see the log"
    port = server.servers[0].sockets[0].getsockname()[1]
    try:
        yield Served(app, f"http://127.0.0.1:{port}", loops[0], data)
    finally:
        server.should_exit = True
        thread.join(20)
        assert not thread.is_alive()


def refusal_code(answer: httpx.Response) -> tuple[int, str]:
    """Status and code of an answer that must be a problem."""
    assert answer.headers["content-type"] == "application/problem+json", answer.text
    return answer.status_code, answer.json()["code"]


def fault_places(answer: httpx.Response) -> list[str]:
    """Places of the faults in a problem."""
    return [fault["where"] for fault in answer.json()["errors"]]


def upload(http: httpx.Client, content: bytes, name: str = "walk.c3d", **fields: str) -> httpx.Response:
    """Upload ``content`` as a file called ``name``."""
    return http.post("/api/v1/recordings", files={"file": (name, content)}, data=fields)


async def _idle_at_start(parts: Parts, with_sample: bool) -> None:
    """In place of the preparation of all robots, which takes 12 s of processor time after every first start."""


def main() -> None:
    """The web server as a program, which imports what reads uploads with the first one, and prepares no robot."""
    api_app.IsolatedPool = LatePool  # type: ignore[attr-defined,misc]
    api_app._warm_robots = _idle_at_start
    api_server.main()


if __name__ == "__main__":
    main()
