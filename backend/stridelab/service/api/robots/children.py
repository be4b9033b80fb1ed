"""Child processes that compute robot files, forked from a server process that has imported the libraries.

The fork server starts with the first child and ends some seconds after the last, so that a service whose robots are
prepared has no rigid-body library in memory.
"""

import asyncio
import tempfile
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress
from pathlib import Path
from typing import Any, Final

import structlog

from stridelab.errors import Unavailable
from stridelab.service.processes.pool import IsolatedPool
from stridelab.service.processes.sandbox import STRICT, Sandbox

log = structlog.get_logger(__name__)

DESCRIBE: Final = "stridelab.service.kinds.robots.description:run"
LINKS: Final = "stridelab.service.kinds.robots.links:run"
REACH: Final = "stridelab.service.kinds.robots.reachability:run"
FORK_SERVER_MODULES: Final = tuple(target.partition(":")[0] for target in (DESCRIBE, LINKS, REACH))
"""Modules that the fork server imports in advance; importing them in each child would take seconds."""
IDLE_S: Final = 20.0

Progress = Callable[[float, str], None]


class RobotChildren:
    """Runs one child process per task in ``pool``, and closes the pool when it has been idle for some seconds."""

    def __init__(
        self,
        pool: IsolatedPool,
        spool: Path,
        memory_mb: int,
        sandbox: Sandbox | None = STRICT,
        idle_s: float = IDLE_S,
    ) -> None:
        self._pool, self._spool, self._memory_mb, self._idle_s = pool, spool, memory_mb, idle_s
        self._sandbox = sandbox
        self._n_running = 0
        self._closing = asyncio.Lock()
        self._idle_task: asyncio.Task[None] | None = None

    @asynccontextmanager
    async def run(
        self, target: str, task: dict[str, str], timeout_s: float, progress: Progress, *, yields: bool = False
    ) -> AsyncIterator[tuple[dict[str, Any], Path]]:
        """Run ``target`` on ``task``; yields its return value and the folder with its files, removed on exit.

        With ``yields``, the child has low priority, because no client waits for it. Raises the error of the child, or
        ``Unavailable`` (``robot-not-loaded``) if it crashed or exceeded a limit.
        """
        with tempfile.TemporaryDirectory(dir=self._spool) as folder:
            self._count_start()
            try:
                async with self._closing:  # wait while the pool is being closed
                    pass
                outcome = await self._pool.run(
                    target,
                    task,
                    Path(folder),
                    timeout_s=timeout_s,
                    memory_mb=self._memory_mb,
                    on_progress=progress,
                    low_priority=yields,
                    sandbox=self._sandbox,
                )
            finally:
                self._count_end()
            if outcome.error_class is not None:
                raise outcome.as_error()
            if outcome.state != "ok":
                log.error("robot not loaded", **task, state=outcome.state, log_tail=outcome.log_tail[-2000:])
                raise Unavailable(
                    "robot-not-loaded",
                    f"The model of {task['robot']} could not be loaded; the service's log has the details.",
                )
            yield outcome.value, Path(folder)

    async def aclose(self) -> None:
        """Close the pool."""
        if self._idle_task is not None:
            self._idle_task.cancel()
            with suppress(asyncio.CancelledError):
                await self._idle_task
        await self._pool.close()

    def _count_start(self) -> None:
        self._n_running += 1

    def _count_end(self) -> None:
        self._n_running -= 1
        if self._n_running == 0 and (self._idle_task is None or self._idle_task.done()):
            self._idle_task = asyncio.get_running_loop().create_task(self._close_when_idle())

    async def _close_when_idle(self) -> None:
        """Close the pool when no child has run for the idle time."""
        quiet_s, step_s = 0.0, self._idle_s / 4
        while quiet_s < self._idle_s:
            await asyncio.sleep(step_s)
            quiet_s = 0.0 if self._n_running else quiet_s + step_s
        async with self._closing:
            if not self._n_running:
                await self._pool.close()
