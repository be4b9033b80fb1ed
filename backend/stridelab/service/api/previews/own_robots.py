"""Preview processes of users' robots: one child per robot, for the few that were used last.

The files of a robot are staged in a folder of its child, as for a job. A changed card or newly learned densities start
another child.
"""

import asyncio
import tempfile
from collections import OrderedDict
from collections.abc import AsyncIterator, Mapping
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from sqlalchemy.ext.asyncio import AsyncEngine

from stridelab.errors import Busy
from stridelab.robots.card import robot_names
from stridelab.service.processes.pool import IsolatedPool
from stridelab.service.processes.resident import Json, PreviewProcess
from stridelab.service.storage.blobs import BlobStore
from stridelab.service.stored_robots import find_robot, robot_version, stage_robot

MAX_PROCESSES: Final = 2
"""Robots of users with a child at the same time, each of about 150 MB; that of the least recently used one ends."""


@dataclass(eq=False)
class _Planner:
    """The child of one robot, and how many requests use it."""

    version: str
    process: PreviewProcess
    open: AsyncExitStack = field(default_factory=AsyncExitStack)
    users: int = 0


class OwnRobotPlanners:
    """Routes questions about a robot to its planner: of a user's robot to a child of its own."""

    def __init__(self, pool: IsolatedPool, engine: AsyncEngine, blobs: BlobStore, spool: Path) -> None:
        self._pool, self._engine, self._blobs, self._spool = pool, engine, blobs, spool
        self._planners: OrderedDict[str, _Planner] = OrderedDict()
        self._changing = asyncio.Lock()

    async def ask(self, robot: str, request: Json, bundled: PreviewProcess) -> Json:
        """The answer of the planner of ``robot``, which is ``bundled`` unless the robot is a user's.

        Raises as ``PreviewProcess.ask``, and ``Busy`` (``preview-busy``) if too many robots of users are in use.
        """
        row = await self._row_of(robot)
        if row is None:
            return await bundled.ask(request)
        async with self._use(robot, row) as process:
            return await process.ask(request)

    async def version(self, robot: str) -> str:
        """Identifies card and densities of a user's robot; empty for any other name."""
        row = await self._row_of(robot)
        return "" if row is None else robot_version(row)

    async def aclose(self) -> None:
        """End all children and remove their folders."""
        while self._planners:
            await self._planners.popitem()[1].open.aclose()

    async def _row_of(self, robot: str) -> Mapping[str, Any] | None:
        if robot in robot_names():
            return None
        async with self._engine.connect() as connection:
            return await find_robot(connection, robot)

    @asynccontextmanager
    async def _use(self, robot: str, row: Mapping[str, Any]) -> AsyncIterator[PreviewProcess]:
        async with self._changing:
            planner = self._planners.get(robot)
            if planner is None or planner.version != robot_version(row):
                planner = await self._open_planner(robot, row)
            self._planners.move_to_end(robot)
            planner.users += 1
        try:
            yield planner.process
        finally:
            planner.users -= 1
            if self._planners.get(robot) is not planner and not planner.users:
                await planner.open.aclose()  # replaced while it was in use

    async def _open_planner(self, robot: str, row: Mapping[str, Any]) -> _Planner:
        """Stage the robot and open its planner; replaced and least recently used ones end when no request uses them."""
        replaced = self._planners.pop(robot, None)
        if replaced is not None and not replaced.users:
            await replaced.open.aclose()
        while len(self._planners) >= MAX_PROCESSES:
            idle = next((name for name, one in self._planners.items() if not one.users), None)
            if idle is None:
                raise Busy("preview-busy", "Too many robots are being previewed at this moment.", 1.0)
            await self._planners.pop(idle).open.aclose()
        async with AsyncExitStack() as stack:
            folder = Path(stack.enter_context(tempfile.TemporaryDirectory(dir=self._spool)))
            async with self._engine.connect() as connection:
                version = await stage_robot(connection, self._blobs, robot, folder)
            process = await stack.enter_async_context(PreviewProcess(self._pool, folder=folder))
            planner = _Planner(version or robot_version(row), process, stack.pop_all())
        self._planners[robot] = planner
        return planner
