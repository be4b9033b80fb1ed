"""Runs computations in killable processes: a crash, hang or memory excess affects only its own task.

Children are forked from a fork server with preloaded libraries (``fork_server_client``), so that starting a task takes
milliseconds. ``IsolatedPool.run`` starts a child for one task, so that no state leaks from one task to the next;
``IsolatedPool.open_session`` starts a child that answers many tasks of one client, one at a time.
"""

import asyncio
import math
from collections.abc import AsyncIterator, Mapping, Sequence
from contextlib import asynccontextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

from stridelab.service.processes.fork_server_client import ForkServerClient
from stridelab.service.processes.priority import LIVE_NICENESS, NICENESS
from stridelab.service.processes.running_child import IsolatedOutcome, OnProgress, RunningChild
from stridelab.service.processes.sandbox import STRICT, Sandbox

START_TIMEOUT_S: Final = 60.0
"""Time limit of the first answer of a session, which includes the import of its libraries."""
ANSWER_TIMEOUT_S: Final = 10.0


class ChildSession:
    """A child that answers tasks one at a time, each within ``answer_s``."""

    def __init__(self, child: RunningChild, answer_s: float) -> None:
        self._child, self._answer_s = child, answer_s
        self._is_first = True

    @property
    def pid(self) -> int | None:
        """Process id of the child; None before its first task and after its end."""
        return self._child.pid

    @property
    def has_ended(self) -> bool:
        """Whether the child has ended."""
        return self._child.has_ended

    async def run(
        self, task: Mapping[str, Any], *, answer_s: float | None = None, on_progress: OnProgress | None = None
    ) -> IsolatedOutcome:
        """Run ``task``, within ``answer_s`` if given. The child goes on after an outcome ``ok`` or ``error`` only."""
        answer_s = self._answer_s if answer_s is None else answer_s
        timeout_s = max(START_TIMEOUT_S, answer_s) if self._is_first else answer_s
        outcome = await self._child.run_task(task, timeout_s=timeout_s, on_progress=on_progress)
        self._is_first = False
        return outcome


class IsolatedPool:
    """Asynchronous context manager: runs tasks in children that have imported ``preload``, for one event loop.

    Children have ``niceness`` (0 to 19) unless a client waits for them, and use at most ``cores`` (default: all).
    """

    def __init__(self, preload: Sequence[str] = (), niceness: int = NICENESS, cores: int | None = None) -> None:
        self._preload, self._niceness, self._cores = tuple(preload), niceness, cores
        self._fork_server: ForkServerClient | None = None
        self._starting = asyncio.Lock()

    async def __aenter__(self) -> "IsolatedPool":  # noqa: PYI034
        await self._running_fork_server()
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()

    async def close(self) -> None:
        """Kill the fork server and all children; a later ``run`` starts a new one."""
        if self._fork_server is not None:
            await self._fork_server.close()
            self._fork_server = None

    async def run(
        self,
        target: str,
        task: Mapping[str, Any],
        folder: Path,
        *,
        timeout_s: float,
        memory_mb: int,
        processor_s: float = math.inf,
        cancel: asyncio.Event | None = None,
        on_progress: OnProgress | None = None,
        low_priority: bool = True,
        sandbox: Sandbox | None = STRICT,
    ) -> IsolatedOutcome:
        """Run ``target`` (``"module:function"``) as ``f(task, folder, progress)`` in a new child.

        ``timeout_s`` starts when the child is ready; ``processor_s`` limits the child's processor time. Setting
        ``cancel``, or cancelling the calling task, kills the child and all its processes. With ``low_priority`` the
        child has the niceness of the pool. A task whose child was killed before it was ready is repeated once.

        ``sandbox`` restricts the child; None is for tasks without untrusted input.
        """
        for is_last in (False, True):
            child = await self._fork_child(
                target, self._niceness if low_priority else 0, folder=folder, memory_mb=memory_mb, sandbox=sandbox
            )
            try:
                outcome = await child.run_task(
                    task,
                    timeout_s=timeout_s,
                    processor_s=processor_s,
                    memory_mb=memory_mb,
                    cancel=cancel,
                    on_progress=on_progress,
                )
            finally:
                await asyncio.shield(child.kill_and_release())
            if outcome.state != "killed" or child.was_ready or is_last:
                break
        return outcome

    @asynccontextmanager
    async def open_session(
        self,
        target: str,
        *,
        memory_mb: int,
        answer_s: float = ANSWER_TIMEOUT_S,
        idle_s: int = 0,
        folder: Path | None = None,
        live: bool = False,
    ) -> AsyncIterator[ChildSession]:
        """Start a child for many tasks of ``target``, with the files of ``folder`` if given; it is killed at exit.

        ``target`` names a function, or a class of which the child creates one object and calls it as the function. The
        child ends by itself after ``idle_s`` without a task (0: never). A ``live`` child precedes other processes where
        the system permits it.
        """
        niceness = LIVE_NICENESS if live else 0
        child = await self._fork_child(
            target, niceness, folder=folder, memory_mb=memory_mb, sandbox=STRICT, idle_s=idle_s, once=False
        )
        try:
            yield ChildSession(child, answer_s)
        finally:
            await asyncio.shield(child.kill_and_release())

    async def _fork_child(
        self,
        target: str,
        niceness: int,
        *,
        folder: Path | None,
        memory_mb: int,
        sandbox: Sandbox | None,
        idle_s: int = 0,
        once: bool = True,
    ) -> RunningChild:
        setup = {
            "target": target,
            "folder": None if folder is None else str(folder.resolve()),
            "memory_mb": memory_mb,
            "cores": self._cores,
            "sandbox": None if sandbox is None else asdict(sandbox),
            "once": once,
            "idle_s": idle_s,
        }
        nursery = await self._running_fork_server()
        try:
            return RunningChild(nursery, await nursery.fork_child(niceness), setup)
        except OSError:  # the fork server ended between the two calls
            nursery = await self._running_fork_server()
            return RunningChild(nursery, await nursery.fork_child(niceness), setup)

    async def _running_fork_server(self) -> ForkServerClient:
        async with self._starting:
            if self._fork_server is not None and self._fork_server.is_gone:
                await self.close()
            if self._fork_server is None:
                self._fork_server = await ForkServerClient.start_server(self._preload)
            return self._fork_server
