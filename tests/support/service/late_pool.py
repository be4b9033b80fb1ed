"""A pool whose imports wait for its first task and are left to the next pool: imports cost a second or two."""

import asyncio
import atexit
import os
import socket
import subprocess
import sys
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, Final

from stridelab.service.processes.fork_server_client import _SINGLE_THREADED, ForkServerClient, child_environment
from stridelab.service.processes.pool import IsolatedPool

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
        """One that another client has returned, or else a new one."""
        environment = child_environment() | _SINGLE_THREADED
        environment.pop("PYTEST_CURRENT_TEST", None)
        key = tuple(preload), frozenset(environment.items())
        found = _idle.pop(key, None)
        return Lent(found if found is not None and found.process.poll() is None else Server(key))

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
