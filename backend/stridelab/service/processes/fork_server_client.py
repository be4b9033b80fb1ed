"""The parent's end of the process from which children are forked (``forking``).

Forking one that has imported everything takes milliseconds, where a new interpreter would import for seconds; and what
was imported is in memory once, however many children there are. The nursery is spawned from the event loop's thread,
which must live as long as it does: the kernel kills it, and its children, when that thread ends.
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

from stridelab.service.processes.fork_server import ANSWER, FORK, LET_GO, PING, REQUEST
from stridelab.service.processes.sandbox import MODE, USER
from stridelab.service.processes.watchdog import Silence

_PING_S: Final = 0.5
_LINE_BYTES: Final = 64 * 1024 * 1024
_log = structlog.get_logger(__name__)
_THREADS: Final = ("OMP", "OPENBLAS", "MKL", "NUMEXPR", "VECLIB", "BLIS")
_SECRETS: Final = ("STRIDELAB_", "AWS_", "PG", "AZURE_", "GOOGLE_")
_NEEDED: Final = frozenset({"STRIDELAB_NATIVE_PATH", MODE, USER})
"""The folder of the C++ solver, in which computations look for it, and what a child gives up: no secrets."""
_SINGLE_THREADED: Final = {"JE_ARROW_MALLOC_CONF": "background_thread:false"}
"""Arrow's allocator would start a thread at import, and a process with threads is not safely forked."""


@dataclass
class Forked:
    """A child as it was forked: the wire to converse on, what it prints, and the code with which it ended."""

    serial: int
    heard: asyncio.StreamReader
    told: asyncio.StreamWriter
    log: asyncio.StreamReader
    log_transport: asyncio.BaseTransport
    ended: "asyncio.Future[int]" = field(repr=False)


class Nursery:
    """One such process. Made by ``start``; ``close`` kills it and all that it forked."""

    def __init__(self, process: asyncio.subprocess.Process, control: socket.socket) -> None:
        self._process, self._control = process, control
        self._loop = asyncio.get_running_loop()
        self._children: dict[int, asyncio.Future[int]] = {}
        self._serial = 0
        self._heard = b""
        self._is_gone = False
        self._loop.add_reader(control, self._hear)
        self._silence = Silence(process.pid)
        self._is_asked = False
        self._watching = self._loop.create_task(self._watch())

    @staticmethod
    async def start(preload: Sequence[str]) -> "Nursery":
        """Start the process, which imports ``preload`` first."""
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
                env=child_environment() | _SINGLE_THREADED,
                start_new_session=True,
            )
        ours.setblocking(False)
        return Nursery(process, ours)

    @property
    def pid(self) -> int:
        """Process number."""
        return self._process.pid

    @property
    def is_gone(self) -> bool:
        """Whether it has ended, so that another one is wanted."""
        return self._is_gone

    async def fork(self, niceness: int) -> Forked:
        """A new child, which yields the processor to everybody else by ``niceness`` (0 to 19).

        Raises ``OSError`` where the nursery has just ended.
        """
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
                self._end()
                raise
        ended = self._children[serial] = self._loop.create_future()
        kept = asyncio.StreamReader()
        heard, told = await asyncio.open_connection(sock=wire, limit=_LINE_BYTES)
        transport, _ = await self._loop.connect_read_pipe(
            lambda: asyncio.StreamReaderProtocol(kept), os.fdopen(log, "rb", buffering=0)
        )
        return Forked(serial, heard, told, kept, transport, ended)

    def let_go(self, child: Forked) -> None:
        """Be done with a child: from when it has ended its process number may become somebody else's."""
        child.told.close()
        child.log_transport.close()
        self._children.pop(child.serial, None)
        with contextlib.suppress(OSError):  # the nursery has ended, and its children with it
            self._control.send(REQUEST.pack(LET_GO, child.serial, 0))

    async def close(self) -> None:
        """Kill it, and wait until it has ended."""
        with contextlib.suppress(ProcessLookupError):
            self._process.kill()
        await self._process.wait()
        self._end()

    def _hear(self) -> None:
        try:
            said = self._control.recv(1 << 16)
        except BlockingIOError:
            return
        except OSError:
            said = b""
        if not said:
            self._end()
            return
        self._heard += said
        whole = len(self._heard) // ANSWER.size * ANSWER.size
        for serial, code in ANSWER.iter_unpack(self._heard[:whole]):
            if serial == 0:  # children are counted from 1
                self._is_asked = False
                self._silence.heard()
            self._settle(self._children.get(serial), code)
        self._heard = self._heard[whole:]

    async def _watch(self) -> None:
        """Kill the process where it does not answer; who needs a child then finds another one."""
        while True:
            if not self._is_asked:
                with contextlib.suppress(OSError):  # its buffer is full, or it has just ended
                    self._control.send(REQUEST.pack(PING, 0, 0))
                    self._is_asked = True
            await asyncio.sleep(_PING_S)
            if self._is_asked and (verdict := self._silence.verdict()) is not None:
                _log.warning("nursery replaced", why=verdict)
                with contextlib.suppress(ProcessLookupError):
                    self._process.kill()
                return

    def _end(self) -> None:
        if not self._is_gone:
            self._is_gone = True
            self._watching.cancel()
            self._loop.remove_reader(self._control)
            self._control.close()
            for ended in self._children.values():
                self._settle(ended, -signal.SIGKILL)  # by the kernel, with the nursery

    @staticmethod
    def _settle(ended: "asyncio.Future[int] | None", code: int) -> None:
        if ended is not None and not ended.done():
            ended.set_result(code)


def child_environment() -> dict[str, str]:
    """The environment of a process that computes: no secrets, one thread per library."""
    environment = {key: value for key, value in os.environ.items() if key in _NEEDED or not key.startswith(_SECRETS)}
    # Arrow's own allocator reserves 1 GiB of addresses at once: all that a child that reads an upload may have.
    return (
        environment | {f"{library}_NUM_THREADS": "1" for library in _THREADS} | {"ARROW_DEFAULT_MEMORY_POOL": "system"}
    )
