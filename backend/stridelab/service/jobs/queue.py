"""Job queue: waiting rows of ``job``, which workers claim in turns of their owners.

The job's row is the queue: it waits while its state is ``queued``, and a worker claims it by the statement that starts
its next attempt. Every change to ``queued`` notifies the workers (``events.emit_event``).

A free slot goes to the owner with the fewest running jobs, ties to the owner whose last job started longest ago. An
owner with one waiting and no running job therefore waits for at most one job of every other owner, however many these
have queued. Jobs of one owner are ordered by priority, then by submission time, so that a job reclaimed from a dead
worker keeps its place; jobs without owner share one queue. Workers that claim at the same time do not see each other's
choice: an owner may be ahead by one job per worker.
"""

import asyncio
import math
import secrets
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import Any, Final, Literal

from psycopg import OperationalError as DriverError
from sqlalchemy import delete, insert, text
from sqlalchemy.exc import InterfaceError, OperationalError

from stridelab.service.jobs.events import CHANNEL
from stridelab.service.storage.database import make_engine
from stridelab.service.storage.tables import worker

Lane = Literal["short", "long"]
LANES: Final[tuple[Lane, ...]] = ("short", "long")
"""``short`` has a reserved slot in every worker, so that long jobs cannot block interactive ones."""
DATABASE_UNAVAILABLE: Final = (OperationalError, InterfaceError, DriverError, TimeoutError)
"""Exceptions raised while the database is unavailable, for every driver in use."""

_BEAT = text(
    """
    WITH earlier AS (SELECT id, last_heartbeat FROM worker WHERE id = :worker FOR UPDATE)
    UPDATE worker SET last_heartbeat = now() FROM earlier WHERE worker.id = earlier.id
    RETURNING CAST(extract(epoch FROM now() - earlier.last_heartbeat) AS double precision)
    """
)
_UNANSWERED = text(
    """
    SELECT * FROM job
     WHERE state = 'running' AND worker_id = :worker AND lane = ANY(:lanes)
       AND NOT EXISTS (SELECT 1 FROM unnest(CAST(:ids AS text[]), CAST(:starts AS timestamptz[])) AS held (id, start)
                        WHERE held.id = job.id AND held.start = job.started_at)
     LIMIT 1
    """
)
"""A job of this worker that it does not hold: it claimed it without an answer, because the connection broke, or the
database was restored from an earlier state."""
CHECK_S: Final = 2.0
"""Interval of looking for ``_UNANSWERED``, at once after a claim that failed."""
_CLAIM = text(
    """
    WITH RECURSIVE first AS (  -- of every owner, by one look into the index job_waiting each
        (SELECT coalesce(owner, '') AS owner, priority, created_at, id
           FROM job WHERE state = 'queued' AND lane = ANY(:lanes)
          ORDER BY coalesce(owner, ''), priority DESC, created_at, id LIMIT 1)
        UNION ALL
        SELECT later.* FROM first CROSS JOIN LATERAL (
            SELECT coalesce(owner, ''), priority, created_at, id
              FROM job WHERE state = 'queued' AND lane = ANY(:lanes) AND coalesce(owner, '') > first.owner
             ORDER BY coalesce(owner, ''), priority DESC, created_at, id LIMIT 1
        ) AS later
    ), running AS MATERIALIZED (
        SELECT coalesce(owner, '') AS owner FROM job WHERE state = 'running'
    ), turn AS (
        SELECT owner FROM first
         ORDER BY (SELECT count(*) FROM running WHERE running.owner = first.owner),
                  (SELECT max(started_at) FROM job WHERE coalesce(owner, '') = first.owner) NULLS FIRST,
                  priority DESC, created_at, id
    ), next AS (
        SELECT waiting.id FROM turn CROSS JOIN LATERAL (
            SELECT id FROM job WHERE state = 'queued' AND lane = ANY(:lanes) AND coalesce(owner, '') = turn.owner
             ORDER BY priority DESC, created_at, id LIMIT 1 FOR UPDATE SKIP LOCKED
        ) AS waiting LIMIT 1
    ), started AS (
        UPDATE job SET state = 'running', attempt = attempt + 1, worker_id = :worker, started_at = now(),
                       fraction = 0, message = ''
          FROM next WHERE job.id = next.id RETURNING job.*
    ), event AS (
        INSERT INTO job_event (job_id, state, attempt, fraction, message)
        SELECT id, state, attempt, fraction, message FROM started
    )
    SELECT started.*, pg_notify(:channel, id) FROM started
    """
)

_EPOCH: Final = datetime.fromtimestamp(0, UTC)
_MICROSECOND: Final = timedelta(microseconds=1)
_PLANNER: Final = "-c enable_bitmapscan=off"
"""Statistics are always late for a queue: believing that few jobs wait, the planner would sort all that do."""


def attempt_prefix(job_id: str, number: int, started_at: datetime | None) -> str:
    """Key prefix of the files of a start of a job."""
    return f"results/{job_id}/{number}" + ("" if started_at is None else f"-{(started_at - _EPOCH) // _MICROSECOND:x}")


@dataclass(frozen=True)
class Attempt:
    """One start of a job; ``row`` is the job's row at that moment."""

    job_id: str
    number: int
    kind: str
    row: Mapping[str, Any]

    @property
    def started_at(self) -> datetime:
        """Time of the start by the clock of the database; tells it from another start of the same number.

        Numbers repeat when the database is restored from an earlier state while workers run.
        """
        started_at: datetime = self.row["started_at"]
        return started_at

    @property
    def counted_starts(self) -> int:
        """Number of starts of the job including this one, without those that were handed back by a stopping worker."""
        return int(self.number - self.row["returned"])

    @property
    def blob_prefix(self) -> str:
        """Key prefix of the files of this attempt."""
        return attempt_prefix(self.job_id, self.number, self.started_at)


class QueueConsumer:
    """A worker's side of the queue: its row with its heartbeat, and the attempts that it holds.

    All statements are transactions of their own, on connections that no job can occupy.
    """

    def __init__(self, url: str) -> None:
        self._engine = make_engine(url, pool_size=2, planner=_PLANNER, autocommit=True)
        self.worker_id: int | None = None
        """Its row in the database; None before the first heartbeat."""
        self._held: set[tuple[str, datetime]] = set()
        self._checked_at_s: dict[tuple[Lane, ...], float] = {}
        """When ``_UNANSWERED`` last returned nothing."""
        self._claiming = asyncio.Lock()
        self._registering = asyncio.Lock()

    async def close(self) -> None:
        """Close the connections."""
        await self._engine.dispose()

    async def send_heartbeat(self) -> float:
        """Send this worker's heartbeat; returns the seconds since its last one by the clock of the database.

        Registers the worker, and returns 0, if it is not registered (any more).
        """
        async with self._registering, self._engine.connect() as connection:
            if self.worker_id is not None:
                silent_s = (await connection.execute(_BEAT, {"worker": self.worker_id})).scalar_one_or_none()
                if silent_s is not None:
                    return float(silent_s)
            # a sequence that was restored from an earlier state would give the ids of running workers again
            registered = insert(worker).values(id=secrets.randbits(62)).returning(worker.c.id)
            self.worker_id = (await connection.execute(registered)).scalar_one()
            return 0.0

    async def claim_attempt(self, lanes: Sequence[Lane]) -> Attempt | None:
        """Start the next waiting job of ``lanes`` on this worker; None if none waits.

        Safe to repeat after a connection broke: a job that was started without an answer is returned first.
        """
        async with self._claiming:
            if self.worker_id is None:
                await self.send_heartbeat()
            mine = {"worker": self.worker_id, "lanes": list(lanes)}
            row, now_s, key = None, time.monotonic(), tuple(lanes)
            try:
                async with self._engine.connect() as connection:
                    if now_s - self._checked_at_s.get(key, -math.inf) >= CHECK_S:
                        ids, starts = [job_id for job_id, _ in self._held], [start for _, start in self._held]
                        claimed = await connection.execute(_UNANSWERED, {**mine, "ids": ids, "starts": starts})
                        row = claimed.mappings().one_or_none()
                        if row is None:
                            self._checked_at_s[key] = now_s
                    if row is None:
                        row = (await connection.execute(_CLAIM, {**mine, "channel": CHANNEL})).mappings().one_or_none()
            except BaseException:
                self._checked_at_s.clear()
                raise
            if row is None:
                return None
            attempt = Attempt(row["id"], row["attempt"], row["kind"], dict(row))
            self._held.add((attempt.job_id, attempt.started_at))
        return attempt

    def release_attempt(self, attempt: Attempt) -> None:
        """Forget an attempt that has ended."""
        self._held.discard((attempt.job_id, attempt.started_at))

    async def unregister_worker(self) -> None:
        """Unregister this worker; jobs that it still runs become lost."""
        if self.worker_id is not None:
            async with self._engine.connect() as connection:
                await connection.execute(delete(worker).where(worker.c.id == self.worker_id))
            self.worker_id = None
