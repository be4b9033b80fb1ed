"""The live robots of this process, with their limits."""

import asyncio
import tempfile
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Final

from sqlalchemy.ext.asyncio import AsyncEngine

from stridelab.errors import Busy, NotFound
from stridelab.schemas.live.messages import LiveSession
from stridelab.service.api.live.room import RETRY_S, LiveMotion, LiveRoom
from stridelab.service.processes.pool import ChildSession, IsolatedPool
from stridelab.service.settings import Settings
from stridelab.service.storage.blobs import BlobStore
from stridelab.service.stored_robots import stage_robot

SIMULATION: Final = "stridelab.service.api.live.child:LiveSimulation"
MEMORY_MB: Final = 2048
"""Memory limit of a live robot's child beyond its libraries."""


class LiveRooms:
    """Opens live robots; ``aclose`` ends them all."""

    def __init__(
        self, pool: IsolatedPool, engine: AsyncEngine, blobs: BlobStore, spool: Path, settings: Settings
    ) -> None:
        self._pool, self._engine, self._blobs, self._spool, self._settings = pool, engine, blobs, spool, settings
        self._rooms: dict[str, LiveRoom] = {}
        self._tasks: dict[str, asyncio.Task[None]] = {}

    def open_room(self, motion: LiveMotion, user: str | None) -> LiveRoom:
        """Start a live robot of ``user``. Raises ``Busy`` (``too-many-live``)."""
        limits, own = self._settings, [room for room in self._rooms.values() if room.owner == user]
        if len(self._rooms) >= limits.live_limit:
            raise Busy(
                "too-many-live", f"{limits.live_limit} robots are live already, the limit of this service.", RETRY_S
            )
        if user is not None and 0 < limits.user_live_limit <= len(own):
            raise Busy("too-many-live", f"You have {limits.user_live_limit} live robots already, the limit.", RETRY_S)
        room = LiveRoom(motion, user, limits.live_idle_s)
        self._rooms[room.session_id] = room
        task = asyncio.create_task(room.run(lambda: self._open_child(motion.robot)))
        self._tasks[room.session_id] = task
        task.add_done_callback(lambda _: self._forget(room.session_id))
        return room

    def describe_all(self) -> list[LiveSession]:
        """All live robots, the newest first."""
        return [room.describe() for room in reversed(self._rooms.values())]

    def require_room(self, session_id: str) -> LiveRoom:
        """The live robot with this id. Raises ``NotFound`` (``session-not-found``)."""
        room = self._rooms.get(session_id)
        if room is None:
            raise NotFound("session-not-found", "There is no live robot with this id; it may have ended.")
        return room

    async def close_room(self, session_id: str) -> None:
        """End a live robot. Raises ``NotFound`` (``session-not-found``)."""
        self.require_room(session_id)
        task = self._tasks[session_id]
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)

    async def aclose(self) -> None:
        """End all live robots."""
        for session_id in list(self._rooms):
            await self.close_room(session_id)

    def _forget(self, session_id: str) -> None:
        del self._rooms[session_id], self._tasks[session_id]

    @asynccontextmanager
    async def _open_child(self, robot: str) -> AsyncIterator[ChildSession]:
        """A child with the files of a user's robot in its folder."""
        with tempfile.TemporaryDirectory(dir=self._spool) as name:
            folder = Path(name)
            async with self._engine.connect() as connection:
                own = await stage_robot(connection, self._blobs, robot, folder)
            async with self._pool.open_session(
                SIMULATION, memory_mb=MEMORY_MB, folder=None if own is None else folder, live=True
            ) as child:
                yield child
