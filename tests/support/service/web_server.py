"""The web application on a real port, in a thread of the test process, with parts that a test can look into."""

import asyncio
import ssl
import threading
from collections.abc import Awaitable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar
from unittest import mock

import httpx
import structlog
import uvicorn
from fastapi import FastAPI

from stridelab.service.api.app import create_app
from stridelab.service.api.dependencies import Parts
from stridelab.service.settings import Settings
from support.service.late_pool import LatePool

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
        kept = {str(path.relative_to(blobs)) for path in blobs.rglob("*") if path.is_file()}
        return kept | {f"spool/{path.name}" for path in (self.data / "spool").glob("*/files/*")}


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
