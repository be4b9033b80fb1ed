"""A worker's side of the queue: whose turn it is, heartbeats, and who holds what.

A free slot goes to the owner with the fewest jobs in workers' hands, among several to the one whose last job was
started longest ago. So whoever has one job waiting and none in hand waits for at most one job of every other owner,
however many these have waiting. Priority, then the time of submission, order the jobs of one owner, so that a job
taken from a dead worker keeps its place; all jobs without an owner have the same one. Workers that fetch at the same
moment know nothing of each other's choice: each may be ahead by one job.
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
from stridelab.service.storage.database import PATIENCE, conninfo

DATABASE_IS_AWAY: Final = (OperationalError, InterfaceError, DriverError, ConnectorException, TimeoutError)
"""What a database that does not answer looks like, by whichever way it was asked."""
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
        """The waiting delivery of ``lanes`` whose turn it is, or None; it is this worker's from now on."""
        async with self._fetching:
            if self._worker is None:
                await self.beat()
            if self._in_doubt:
                # a connection broke while fetching: what was marked as ours without our hearing of it goes back
                await self._connector.execute_query_async(_RECLAIM, worker=self._worker, known=list(self._held))
                self._in_doubt = False
            try:
                found = await self._connector.execute_query_all_async(
                    _FETCH, lanes=list(lanes), worker=self._known_worker()
                )
            except BaseException:
                self._in_doubt = True
                raise
            if not found:
                return None
            made = Delivery(int(found[0]["id"]), str(found[0]["job_id"]))
            self._held.add(made.id)
        return made

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
