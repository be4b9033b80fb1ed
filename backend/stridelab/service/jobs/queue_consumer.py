"""A worker's side of the queue: fair scheduling, heartbeats and held deliveries.

A free slot goes to the owner with the fewest running jobs, ties to the owner whose last job started longest ago. An
owner with one waiting and no running job therefore waits for at most one job of every other owner, however many these
have queued. Jobs of one owner are ordered by priority, then by submission time, so that a job reclaimed from a dead
worker keeps its place; jobs without owner share one queue. Workers that fetch at the same time do not see each other's
choice: an owner may be ahead by one job per worker.
"""

import asyncio
from collections.abc import Sequence
from typing import Final, Self

from procrastinate import PsycopgConnector
from procrastinate.exceptions import ConnectorException
from procrastinate.manager import JobManager, get_channel_for_queues
from psycopg import OperationalError as DriverError
from sqlalchemy.exc import InterfaceError, OperationalError

from stridelab.service.jobs.queue import LANES, Delivery, Lane
from stridelab.service.storage.database import CONNECTION_OPTIONS, libpq_url

DATABASE_UNAVAILABLE: Final = (OperationalError, InterfaceError, DriverError, ConnectorException, TimeoutError)
"""Exceptions raised while the database is unavailable, for every driver in use."""
_FETCH = """
    WITH held AS (
        SELECT q.id, q.status, coalesce(j.owner, '') AS owner, j.created_at
          FROM procrastinate_jobs q LEFT JOIN job j ON j.id = q.args ->> 'job_id'
         WHERE q.status IN ('todo', 'doing')
    ), share AS (
        SELECT owner, count(*) FILTER (WHERE status = 'doing') AS in_hand,
               (SELECT max(j.started_at) FROM job j WHERE coalesce(j.owner, '') = held.owner) AS served_at
          FROM held GROUP BY owner
    ), next AS (
        SELECT q.id FROM procrastinate_jobs q JOIN held USING (id) JOIN share USING (owner)
         WHERE q.status = 'todo' AND q.queue_name = ANY(%(lanes)s)
         ORDER BY share.in_hand, share.served_at NULLS FIRST, q.priority DESC, held.created_at, q.id
         LIMIT 1 FOR UPDATE OF q SKIP LOCKED
    )
    UPDATE procrastinate_jobs q SET status = 'doing', worker_id = %(worker)s
      FROM next WHERE q.id = next.id RETURNING q.id, q.args ->> 'job_id' AS job_id
"""
_BEAT = "UPDATE procrastinate_workers SET last_heartbeat = now() WHERE id = %(worker)s RETURNING id"
_FINISH = """UPDATE procrastinate_jobs SET status = 'succeeded', attempts = attempts + 1
             WHERE id = %(id)s AND status = 'doing' AND worker_id = %(worker)s"""
_RECLAIM = """UPDATE procrastinate_jobs SET status = 'todo', worker_id = NULL
              WHERE status = 'doing' AND worker_id = %(worker)s AND NOT id = ANY(%(known)s::bigint[])"""
_FORGET = "DELETE FROM procrastinate_workers WHERE last_heartbeat < now() - make_interval(hours => %(hours)s)"


class QueueConsumer:
    """A worker's side of the queue: one registered worker, its heartbeat, and the deliveries it holds."""

    def __init__(self, url: str) -> None:
        self._connector = PsycopgConnector(
            conninfo=libpq_url(url), kwargs=dict(CONNECTION_OPTIONS), min_size=1, max_size=3, timeout=5.0
        )
        self._manager = JobManager(self._connector)
        self._worker: int | None = None
        self._held: set[int] = set()
        self._fetching = asyncio.Lock()
        self._registering = asyncio.Lock()
        self._fetch_interrupted = False

    async def __aenter__(self) -> Self:
        await self._connector.open_async()
        return self

    async def __aexit__(self, *_: object) -> None:
        await self._connector.close_async()

    @staticmethod
    def notify_channels(lanes: Sequence[Lane] = LANES) -> tuple[str, ...]:
        """NOTIFY channels of new deliveries."""
        return tuple(get_channel_for_queues(lanes))

    async def send_heartbeat(self) -> None:
        """Send this worker's heartbeat; register it first if it is not registered (any more)."""
        async with self._registering:
            if self._worker is not None and await self._connector.execute_query_all_async(_BEAT, worker=self._worker):
                return
            self._worker = await self._manager.register_worker()

    async def fetch_delivery(self, lanes: Sequence[Lane]) -> Delivery | None:
        """Claim the next waiting delivery of ``lanes`` for this worker; None if none waits."""
        async with self._fetching:
            if self._worker is None:
                await self.send_heartbeat()
            if self._fetch_interrupted:
                # a connection broke while fetching: release deliveries claimed without the answer having arrived
                await self._connector.execute_query_async(_RECLAIM, worker=self._worker, known=list(self._held))
                self._fetch_interrupted = False
            try:
                rows = await self._connector.execute_query_all_async(
                    _FETCH, lanes=list(lanes), worker=self._require_worker()
                )
            except BaseException:
                self._fetch_interrupted = True
                raise
            if not rows:
                return None
            delivery = Delivery(int(rows[0]["id"]), str(rows[0]["job_id"]))
            self._held.add(delivery.id)
        return delivery

    async def finish_delivery(self, delivery: Delivery) -> None:
        """Mark a delivery as finished; no effect if this worker does not hold it any more."""
        await self._connector.execute_query_async(_FINISH, id=delivery.id, worker=self._require_worker())
        self._held.discard(delivery.id)

    async def unregister_worker(self) -> None:
        """Unregister this worker; deliveries that it still holds become orphans."""
        if self._worker is not None:
            await self._manager.unregister_worker(self._worker)
            self._worker = None

    async def remove_old(self, hours: int) -> None:
        """Delete deliveries that ended, and workers whose last heartbeat came, more than ``hours`` ago."""
        await self._connector.execute_query_async(_FORGET, hours=hours)
        await self._manager.delete_old_jobs(
            nb_hours=hours, include_failed=True, include_cancelled=True, include_aborted=True
        )

    def _require_worker(self) -> int:
        if self._worker is None:
            raise RuntimeError("the worker is not registered")
        return self._worker
