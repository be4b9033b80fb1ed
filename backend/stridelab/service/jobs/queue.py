"""The queue's port: procrastinate carries job ids to workers, and nothing else.

Used of it: its tables and functions (admission in the caller's transaction, workers with heartbeats, NOTIFY on
insert). Not used: its fetching, which knows priorities but no owners, its worker loop, which stops fetching and
beating when the database restarts, and its retry strategies, which end an aborted job as a failed one. Every
delivery is a row of its own; a job that must be delivered again gets a new row, so that whoever still holds an old
one can do no harm with it.

Here is what happens inside somebody's transaction, by the versioned functions of the queue's schema; the library
itself is needed by workers only (``consumer``).
"""

import json
from dataclasses import dataclass
from typing import Final, Literal

from sqlalchemy import text
from sqlalchemy.ext.asyncio import AsyncConnection

Lane = Literal["short", "long"]
LANES: Final[tuple[Lane, ...]] = ("short", "long")
"""``short`` has a reserved slot in every worker, so that a long job on every other slot cannot block a click."""

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
    """One row of the queue in the hands of a worker."""

    id: int
    job_id: str


async def enqueue(connection: AsyncConnection, job_id: str, lane: Lane, priority: int) -> int:
    """Add a delivery of ``job_id`` inside the caller's transaction; returns its id."""
    asked = {"lane": lane, "priority": priority, "arguments": json.dumps({"job_id": job_id})}
    return int((await connection.execute(_DEFER, asked)).scalar_one())


async def retire(connection: AsyncConnection, delivery_id: int | None) -> None:
    """Take a delivery out of the queue, or void it where a worker holds it, inside the caller's transaction."""
    await connection.execute(_RETIRE, {"id": delivery_id})
