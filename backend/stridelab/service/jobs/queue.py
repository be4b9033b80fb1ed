"""Job queue: procrastinate delivers job ids to workers.

Used of procrastinate: its tables and functions (enqueueing in the caller's transaction, workers with heartbeats, NOTIFY
on insert). Not used: its fetching, which has priorities but no owners; its worker loop, which stops fetching and
sending heartbeats when the database restarts; its retry strategies, which end an aborted job as failed. Every delivery
is a separate row; a job that is delivered again gets a new row, so that a stale worker with an old row has no effect.

This module contains the operations inside the caller's transaction, which call the versioned functions of the queue's
schema; only workers need the library itself (``queue_consumer``).
"""

import json
from dataclasses import dataclass
from typing import Final, Literal

from sqlalchemy import text
from sqlalchemy.ext.asyncio import AsyncConnection

Lane = Literal["short", "long"]
LANES: Final[tuple[Lane, ...]] = ("short", "long")
"""``short`` has a reserved slot in every worker, so that long jobs cannot block interactive ones."""

_DEFER = text(
    """
    SELECT unnest(procrastinate_defer_jobs_v1(ARRAY[ROW(
        CAST(:lane AS varchar), 'run-job', CAST(:priority AS integer), NULL, NULL, CAST(:arguments AS jsonb), NULL
    )::procrastinate_job_to_defer_v1]))
    """
)
_RETIRE = text(
    """
    UPDATE procrastinate_jobs
       SET status = CASE status WHEN 'todo' THEN 'cancelled' ELSE 'failed' END::procrastinate_job_status
     WHERE id = :id AND status IN ('todo', 'doing')
    """
)


@dataclass(frozen=True)
class Delivery:
    """A row of the queue that a worker holds."""

    id: int
    job_id: str


async def enqueue(connection: AsyncConnection, job_id: str, lane: Lane, priority: int) -> int:
    """Add a delivery of ``job_id`` inside the caller's transaction; returns its id."""
    parameters = {"lane": lane, "priority": priority, "arguments": json.dumps({"job_id": job_id})}
    return int((await connection.execute(_DEFER, parameters)).scalar_one())


async def retire_delivery(connection: AsyncConnection, delivery_id: int | None) -> None:
    """Remove a delivery from the queue, or invalidate it if a worker holds it, inside the caller's transaction."""
    await connection.execute(_RETIRE, {"id": delivery_id})
