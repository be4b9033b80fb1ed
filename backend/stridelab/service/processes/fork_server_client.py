"""Client of the fork server (``fork_server``).

Forking a process that has imported all libraries takes milliseconds instead of the seconds of a new interpreter, and
all children share the memory of these libraries. The fork server is spawned from the event loop's thread, which must
live as long as the server does: the kernel kills the server and its children when that thread ends.
"""

import asyncio
import contextlib
import os
import signal
import socket
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final

import structlog

from stridelab.machine.cluster import VARIABLE as CLUSTER_VARIABLE
from stridelab.machine.cores import SINGLE_THREADED
from stridelab.service.processes.fork_server import ANSWER, FORK, PING, RELEASE, REQUEST
from stridelab.service.processes.sandbox import MODE_VARIABLE, USER_VARIABLE
from stridelab.service.processes.watchdog import ResponseWatchdog

_PING_S: Final = 0.5
_MAX_LINE_BYTES: Final = 64 * 1024 * 1024
_log = structlog.get_logger(__name__)
_SECRET_PREFIXES: Final = ("STRIDELAB_", "AWS_", "PG", "AZURE_", "GOOGLE_")
_PASSED_VARIABLES: Final = frozenset({"STRIDELAB_NATIVE_PATH", CLUSTER_VARIABLE, MODE_VARIABLE, USER_VARIABLE})
"""Non-secret variables that children need: the folder of the C++ solver, the cluster and the sandbox settings."""


@dataclass
class ForkedChild:
    """A forked child: its communication streams, its output, and its exit code once it has ended."""

    serial: int
    reader: asyncio.StreamReader
    writer: asyncio.StreamWriter
    log: asyncio.StreamReader
    log_transport: asyncio.BaseTransport
    exit_code: "asyncio.Future[int]" = field(repr=False)


class ForkServerClient:
    """A fork server process. Created by ``start_server``; ``close`` kills it and all its children."""

    def __init__(self, process: asyncio.subprocess.Process, control: socket.socket) -> None:
        self._process, self._control = process, control
        self._loop = asyncio.get_running_loop()
        self._children: dict[int, asyncio.Future[int]] = {}
        self._serial = 0
        self._receive_buffer = b""
        self._is_gone = False
        self._loop.add_reader(control, self._on_readable)
        self._watchdog = ResponseWatchdog(process.pid)
        self._ping_pending = False
        self._ping_task = self._loop.create_task(self._ping_loop())

    @staticmethod
    async def start_server(preload: Sequence[str]) -> "ForkServerClient":
        """Start a fork server that imports the modules ``preload``."""
        ours, theirs = socket.socketpair()
        with theirs:
            process = await asyncio.create_subprocess_exec(
                sys.executable,
                "-m",
                "stridelab.service.processes.fork_server",
                str(os.getpid()),
                ",".join(preload),
                stdin=theirs.fileno(),
                stdout=asyncio.subprocess.DEVNULL,
                env=child_environment(),
                start_new_session=True,
            )
        ours.setblocking(False)
        return ForkServerClient(process, ours)

    @property
    def pid(self) -> int:
        """Process id of the fork server."""
        return self._process.pid

    @property
    def is_gone(self) -> bool:
        """Whether the fork server has ended and must be replaced."""
        return self._is_gone

    async def fork_child(self, niceness: int) -> ForkedChild:
        """Fork a child with ``niceness`` (-20 to 19). Raises ``OSError`` if the fork server has just ended."""
        self._serial += 1
        serial = self._serial
        wire, theirs = socket.socketpair()
        log, printed = os.pipe()
        with theirs, os.fdopen(printed, "wb") as their_log:
            try:
                socket.send_fds(
                    self._control, [REQUEST.pack(FORK, serial, niceness)], [theirs.fileno(), their_log.fileno()]
                )
            except OSError:
                wire.close()
                os.close(log)
                self._mark_ended()
                raise
        ended = self._children[serial] = self._loop.create_future()
        log_reader = asyncio.StreamReader()
        reader, writer = await asyncio.open_connection(sock=wire, limit=_MAX_LINE_BYTES)
        transport, _ = await self._loop.connect_read_pipe(
            lambda: asyncio.StreamReaderProtocol(log_reader), os.fdopen(log, "rb", buffering=0)
        )
        return ForkedChild(serial, reader, writer, log_reader, transport, ended)

    def release_child(self, child: ForkedChild) -> None:
        """Release a child: once it has ended, it is reaped and its process id may be reused."""
        child.writer.close()
        child.log_transport.close()
        self._children.pop(child.serial, None)
        with contextlib.suppress(OSError):  # the fork server has ended, and its children with it
            self._control.send(REQUEST.pack(RELEASE, child.serial, 0))

    async def close(self) -> None:
        """Kill the fork server and wait until it has ended."""
        with contextlib.suppress(ProcessLookupError):
            self._process.kill()
        await self._process.wait()
        self._mark_ended()

    def _on_readable(self) -> None:
        try:
            received = self._control.recv(1 << 16)
        except BlockingIOError:
            return
        except OSError:
            received = b""
        if not received:
            self._mark_ended()
            return
        self._receive_buffer += received
        whole = len(self._receive_buffer) // ANSWER.size * ANSWER.size
        for serial, code in ANSWER.iter_unpack(self._receive_buffer[:whole]):
            if serial == 0:  # answer to a ping; serial numbers of children start at 1
                self._ping_pending = False
                self._watchdog.record_answer()
            self._set_exit_code(self._children.get(serial), code)
        self._receive_buffer = self._receive_buffer[whole:]

    async def _ping_loop(self) -> None:
        """Ping the fork server and kill it if it does not respond; the next fork starts a new one."""
        while True:
            if not self._ping_pending:
                with contextlib.suppress(OSError):  # its buffer is full, or it has just ended
                    self._control.send(REQUEST.pack(PING, 0, 0))
                    self._ping_pending = True
            await asyncio.sleep(_PING_S)
            if self._ping_pending and (verdict := self._watchdog.failure_state()) is not None:
                _log.warning("nursery replaced", why=verdict)
                with contextlib.suppress(ProcessLookupError):
                    self._process.kill()
                return

    def _mark_ended(self) -> None:
        if not self._is_gone:
            self._is_gone = True
            self._ping_task.cancel()
            self._loop.remove_reader(self._control)
            self._control.close()
            for ended in self._children.values():
                self._set_exit_code(ended, -signal.SIGKILL)  # the kernel kills them with the fork server

    @staticmethod
    def _set_exit_code(ended: "asyncio.Future[int] | None", code: int) -> None:
        if ended is not None and not ended.done():
            ended.set_result(code)


def child_environment() -> dict[str, str]:
    """Environment of a child process: no secrets, one thread per library."""
    environment = {
        key: value
        for key, value in os.environ.items()
        if key in _PASSED_VARIABLES or not key.startswith(_SECRET_PREFIXES)
    }
    # Arrow's default allocator reserves 1 GiB of address space at once, the entire limit of a parser of uploads.
    return (
        environment
        | SINGLE_THREADED
        | {"ARROW_DEFAULT_MEMORY_POOL": "system"}
        | {"MUJOCO_GL": "disabled"}  # else MuJoCo starts a process to look for a display, which a sandbox forbids
    )
