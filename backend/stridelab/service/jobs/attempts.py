"""State changes that workers make to a job. The attempt's number is the fencing token.

A claim (``jobs.queue``) increments ``attempt``; every later write has the condition ``attempt = mine AND state =
'running'``. The writes of a worker that was declared dead and resumes match no row: it may repeat a computation, but
publishes nothing.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final, Literal

from sqlalchemy import ColumnElement, Update, func, select, text, update
from sqlalchemy.ext.asyncio import AsyncConnection, AsyncEngine

from stridelab.service.jobs.partial_results import NumberedChunk, delete_chunks, insert_chunks
from stridelab.service.jobs.queue import Attempt
from stridelab.service.jobs.store import emit_event
from stridelab.service.kinds.base import JobKind, Json
from stridelab.service.kinds.result_tables import software_versions
from stridelab.service.storage import locks
from stridelab.service.storage.blobs import BlobStore
from stridelab.service.storage.publication import Publication
from stridelab.service.storage.tables import job

FinalState = Literal["failed", "cancelled", "timed_out"]
_LOST = text(
    """
    SELECT job.* FROM job
     WHERE state = 'running'
       AND NOT EXISTS (SELECT 1 FROM worker WHERE worker.id = job.worker_id
                          AND last_heartbeat >= now() - make_interval(secs => :silent_s))
     ORDER BY created_at LIMIT 100 FOR UPDATE SKIP LOCKED
    """
)
_WAITING: Final[Mapping[str, Any]] = {"state": "queued", "worker_id": None, "started_at": None, "fraction": 0.0}
"""Column values of a job that waits again; a start without ``started_at`` is no turn of its owner (``jobs.queue``)."""


class AttemptStore:
    """Fenced state changes of jobs in one database."""

    def __init__(self, engine: AsyncEngine, kinds: Mapping[str, JobKind], *, max_attempts: int = 3) -> None:
        self._engine, self._kinds, self._max_attempts = engine, kinds, max_attempts

    async def report_progress(
        self, attempt: Attempt, fraction: float, message: str, chunks: Sequence[NumberedChunk] = ()
    ) -> bool:
        """Write progress and new parts; False if the attempt should stop (cancelled, or superseded by another)."""
        async with self._engine.begin() as connection:
            change = (
                _fenced_update(attempt)
                .where(~job.c.cancel_requested)
                .values(fraction=fraction, message=without_nul_characters(message))
            )
            if not await _apply_change(connection, attempt, change):
                return False
            await insert_chunks(connection, attempt.job_id, attempt.number, chunks)
            return True

    async def should_stop(self, attempt: Attempt) -> bool:
        """Whether the attempt is cancelled or superseded by another attempt."""
        ours = select(job.c.id).where(*_fencing_conditions(attempt), ~job.c.cancel_requested)
        async with self._engine.connect() as connection:
            return (await connection.execute(ours)).one_or_none() is None

    async def publish_success(
        self,
        attempt: Attempt,
        blobs: BlobStore,
        outcome: Json,
        artifacts: list[Json],
        folder: Path,
        log_tail: str,
        publication: Publication | None = None,
    ) -> bool:
        """Publish the kind's own rows and the result in one transaction; False if the attempt is superseded.

        Safe to repeat after a connection broke during the commit. ``publication`` records whether the outcome of the
        COMMIT is known.
        """
        async with (publication or Publication()).transaction(self._engine) as connection:
            row = await _lock_job_row(connection, attempt.job_id)
            if row is None or row["attempt"] != attempt.number:
                return False
            if row["state"] != "running" or row["cancel_requested"]:
                return bool(row["state"] == "succeeded")
            summary = outcome["summary"]
            publish = self._kinds[attempt.kind].publish
            if publish is not None:
                summary = await publish(connection, blobs, dict(row), outcome, folder) or summary
            result = _result_record(summary, outcome, artifacts)
            change = _fenced_update(attempt).values(
                state="succeeded",
                fraction=1.0,
                message="done",
                finished_at=func.now(),
                result=without_nul_characters(result),
                blob_prefix=attempt.blob_prefix,
                log_tail=without_nul_characters(log_tail),
            )
            return await _end_running(connection, attempt, change)

    async def end_attempt(
        self,
        attempt: Attempt,
        state: FinalState,
        problem: Json | None,
        log_tail: str,
        partial_result: tuple[Json, list[Json]] | None = None,
        publication: Publication | None = None,
    ) -> bool:
        """End without success; False if the attempt is superseded.

        ``partial_result`` is the computation's outcome and its stored artifacts. Safe to repeat after a connection
        broke during the commit; ``publication`` records whether the outcome of the COMMIT is known.
        """
        values: dict[str, Any] = {"state": state, "error": without_nul_characters(problem), "blob_prefix": None}
        if partial_result is not None:
            outcome, artifacts = partial_result
            values["result"] = without_nul_characters(_result_record(outcome["summary"], outcome, artifacts))
            values["blob_prefix"] = attempt.blob_prefix
        async with (publication or Publication()).transaction(self._engine) as connection:
            row = await _lock_job_row(connection, attempt.job_id)
            if row is None or row["attempt"] != attempt.number:
                return False
            if row["state"] != "running":
                # True if an earlier call of this attempt has committed the same end
                return all(row[name] == values[name] for name in ("state", "error", "blob_prefix"))
            change = _fenced_update(attempt).values(
                **values,
                message=state.replace("_", " "),
                finished_at=func.now(),
                log_tail=without_nul_characters(log_tail),
            )
            return await _end_running(connection, attempt, change)

    async def hand_back(self, attempt: Attempt, *, counts: bool = False) -> bool:
        """Queue the job again because its worker stops; this start does not count towards the maximum.

        ``counts`` is True if its process was killed from outside, so that a job that is killed every time fails.
        """
        async with self._engine.begin() as connection:
            change = _fenced_update(attempt).values(
                **_WAITING,
                returned=job.c.returned + (0 if counts else 1),
                message="its process was killed; waiting again" if counts else "waiting again",
            )
            return await _end_running(connection, attempt, change)

    async def requeue_lost(self, silent_s: float | None) -> list[str]:
        """Queue lost jobs again; returns their ids.

        A running job is lost if its worker is not registered or, with ``silent_s``, has sent no heartbeat for that
        long. A job that was started too often fails instead.
        """
        async with self._engine.begin() as connection:
            if not (await connection.execute(select(func.pg_try_advisory_xact_lock(locks.REAPER)))).scalar_one():
                return []
            never = 10.0 * 365 * 86400
            lost = (await connection.execute(_LOST, {"silent_s": never if silent_s is None else silent_s})).mappings()
            rows = list(lost)
            for row in rows:
                change = update(job).where(job.c.id == row["id"])
                await connection.execute(change.values(**self._values_of_lost_job(row)))
                await delete_chunks(connection, row["id"])
                await emit_event(connection, row["id"])
        return [row["id"] for row in rows]

    def _values_of_lost_job(self, row: Mapping[Any, Any]) -> dict[str, Any]:
        """New column values of a lost job: cancelled, failed or queued again."""
        if row["cancel_requested"]:
            return {"state": "cancelled", "finished_at": func.now(), "message": "cancelled"}
        used = row["attempt"] - row["returned"]
        if used >= self._max_attempts:
            problem = {
                "code": "worker-died",
                "detail": f"The worker died {used} times while running this job.",
                "errors": [],
            }
            return {"state": "failed", "finished_at": func.now(), "message": "failed", "error": problem}
        return {**_WAITING, "message": "its worker was lost; waiting again"}


def _result_record(summary: Json, outcome: Json, artifacts: list[Json]) -> Json:
    """The result that is stored in the row of a job."""
    references = list(outcome["references"])
    return {"summary": summary, "references": references, "versions": software_versions(), "artifacts": artifacts}


async def _lock_job_row(connection: AsyncConnection, job_id: str) -> Mapping[str, Any] | None:
    """The job's row, locked until the end of the transaction."""
    result = await connection.execute(select(job).where(job.c.id == job_id).with_for_update())
    row = result.mappings().one_or_none()
    return None if row is None else dict(row)


def _fenced_update(attempt: Attempt) -> Update:
    return update(job).where(*_fencing_conditions(attempt))


def _fencing_conditions(attempt: Attempt) -> tuple[ColumnElement[bool], ...]:
    return job.c.id == attempt.job_id, job.c.attempt == attempt.number, job.c.state == "running"


async def _end_running(connection: AsyncConnection, attempt: Attempt, change: Update) -> bool:
    """Apply a change that ends the attempt, and remove its parts; False if it is superseded by another attempt."""
    if not await _apply_change(connection, attempt, change):
        return False
    await delete_chunks(connection, attempt.job_id)
    return True


async def _apply_change(connection: AsyncConnection, attempt: Attempt, change: Update) -> bool:
    if (await connection.execute(change.returning(job.c.id))).one_or_none() is None:
        return False
    await emit_event(connection, attempt.job_id)
    return True


def without_nul_characters(value: Any) -> Any:
    """Remove NUL characters, which PostgreSQL's text and JSON types do not accept, from a JSON value."""
    if isinstance(value, str):
        return value.replace("\0", "")
    if isinstance(value, Mapping):
        return {without_nul_characters(key): without_nul_characters(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [without_nul_characters(item) for item in value]
    return value
