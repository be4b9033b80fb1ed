"""Events of jobs: every change of a job writes one and notifies those who wait for it, in the same transaction."""

from typing import Final

from sqlalchemy import text
from sqlalchemy.ext.asyncio import AsyncConnection
from sqlalchemy.sql.elements import TextClause

CHANNEL: Final = "stridelab_job"
"""NOTIFY channel; the payload is the id of the job that changed."""
QUEUE_CHANNEL: Final = "stridelab_queue"
"""NOTIFY channel for workers: a job waits."""
CANCEL_CHANNEL: Final = "stridelab_cancel"
"""NOTIFY channel for workers; the payload is the id of a running job to be cancelled."""
EVENT_COLUMNS: Final = "id, state, attempt, fraction, message"
"""Columns of ``job`` that an event repeats."""


def statement_with_events(changed: str, *, ends_attempt: bool = False) -> TextClause:
    """Statement that writes an event for every job of ``changed`` and notifies listeners; it returns one row for each.

    ``changed`` selects or returns ``EVENT_COLUMNS`` of rows that the transaction locks, so that the events of a job
    are numbered in commit order. With ``ends_attempt`` the parts of the jobs are deleted, too. Workers are notified of
    a job that waits.
    """
    parts = ", parts AS (DELETE FROM job_partial WHERE job_id IN (SELECT id FROM changed))" if ends_attempt else ""
    return text(
        f"""
        WITH changed AS ({changed}), event AS (
            INSERT INTO job_event (job_id, state, attempt, fraction, message) SELECT * FROM changed
        ){parts}
        SELECT pg_notify('{CHANNEL}', id), CASE WHEN state = 'queued' THEN pg_notify('{QUEUE_CHANNEL}', '') END
          FROM changed
        """  # noqa: S608 (constants only)
    )


_EMIT_EVENT: Final = statement_with_events(f"SELECT {EVENT_COLUMNS} FROM job WHERE id = :job_id")  # noqa: S608


async def emit_event(connection: AsyncConnection, job_id: str) -> None:
    """Write the state of a job, which the transaction has changed, as an event and notify listeners."""
    await connection.execute(_EMIT_EVENT, {"job_id": job_id})
