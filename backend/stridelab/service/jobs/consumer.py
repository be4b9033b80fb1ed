"""A worker's side of the queue: procrastinate fetches by priority, counts heartbeats and announces what is new."""

import asyncio
from collections.abc import Sequence
from typing import Final, Self

from procrastinate import PsycopgConnector
from procrastinate.exceptions import ConnectorException
from procrastinate.manager import JobManager, get_channel_for_queues
from psycopg import OperationalError as DriverError
from sqlalchemy.exc import InterfaceError, OperationalError

from stridelab.service.jobs.queue import LANES, Delivery, Lane
from stridelab.service.storage.database import PATIENCE, conninfo

DATABASE_IS_AWAY: Final = (OperationalError, InterfaceError, DriverError, ConnectorException, TimeoutError)
"""What a database that does not answer looks like, by whichever way it was asked."""
_BEAT = "UPDATE procrastinate_workers SET last_heartbeat = now() WHERE id = %(worker)s RETURNING id"
_FINISH = """UPDATE procrastinate_jobs SET status = 'succeeded', attempts = attempts + 1
             WHERE id = %(id)s AND status = 'doing' AND worker_id = %(worker)s"""
_RECLAIM = """UPDATE procrastinate_jobs SET status = 'todo', worker_id = NULL
              WHERE status = 'doing' AND worker_id = %(worker)s AND NOT id = ANY(%(known)s::bigint[])"""
_FORGET = "DELETE FROM procrastinate_workers WHERE last_heartbeat < now() - make_interval(hours => %(hours)s)"


class Consumer:
    """A worker's side of the queue: one registered worker, its heartbeat, and the deliveries it holds."""

    def __init__(self, url: str) -> None:
        self._connector = PsycopgConnector(
            conninfo=conninfo(url), kwargs=dict(PATIENCE), min_size=1, max_size=3, timeout=5.0
        )
        self._manager = JobManager(self._connector)
        self._worker: int | None = None
        self._held: set[int] = set()
        self._fetching = asyncio.Lock()
        self._registering = asyncio.Lock()
        self._in_doubt = False

    async def __aenter__(self) -> Self:
        await self._connector.open_async()
        return self

    async def __aexit__(self, *_: object) -> None:
        await self._connector.close_async()

    @staticmethod
    def channels(lanes: Sequence[Lane] = LANES) -> tuple[str, ...]:
        """Channels on which new deliveries are announced."""
        return tuple(get_channel_for_queues(lanes))

    async def beat(self) -> None:
        """Say that this worker lives, registering it first where it is unknown (or was given up as dead)."""
        async with self._registering:
            if self._worker is not None and await self._connector.execute_query_all_async(_BEAT, worker=self._worker):
                return
            self._worker = await self._manager.register_worker()

    async def fetch(self, lanes: Sequence[Lane]) -> Delivery | None:
        """The most urgent waiting delivery of ``lanes``, or None; it is this worker's from now on."""
        async with self._fetching:
            if self._worker is None:
                await self.beat()
            if self._in_doubt:
                # a connection broke while fetching: what was marked as ours without our hearing of it goes back
                await self._connector.execute_query_async(_RECLAIM, worker=self._worker, known=list(self._held))
                self._in_doubt = False
            try:
                job = await self._manager.fetch_job(queues=list(lanes), worker_id=self._known_worker())
            except BaseException:
                self._in_doubt = True
                raise
            if job is None or job.id is None:
                return None
            self._held.add(job.id)
        return Delivery(job.id, str(job.task_kwargs["job_id"]))

    async def finish(self, delivery: Delivery) -> None:
        """Sign off a delivery; does nothing where it is no longer this worker's."""
        await self._connector.execute_query_async(_FINISH, id=delivery.id, worker=self._known_worker())
        self._held.discard(delivery.id)

    async def sign_off(self) -> None:
        """Leave: what this worker still holds has no owner from now on."""
        if self._worker is not None:
            await self._manager.unregister_worker(self._worker)
            self._worker = None

    async def remove_old(self, hours: int) -> None:
        """Delete deliveries that ended more than ``hours`` ago, and workers that have been silent for as long."""
        await self._connector.execute_query_async(_FORGET, hours=hours)
        await self._manager.delete_old_jobs(
            nb_hours=hours, include_failed=True, include_cancelled=True, include_aborted=True
        )

    def _known_worker(self) -> int:
        if self._worker is None:
            raise RuntimeError("the worker is not registered")
        return self._worker
