"""State changes that workers make to a job. The attempt's number is the fencing token.

Starting a job increments ``attempt``; every later write has the condition ``attempt = mine AND state = 'running'``. The
writes of a worker that was declared dead and resumes match no row: it may repeat a computation, but publishes nothing.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from sqlalchemy import ColumnElement, Update, func, select, text, update
from sqlalchemy.ext.asyncio import AsyncConnection, AsyncEngine

from stridelab.service.jobs import queue
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
    SELECT j.id FROM job j
      LEFT JOIN procrastinate_jobs q ON q.id = j.queue_id
      LEFT JOIN procrastinate_workers w ON w.id = q.worker_id
     WHERE j.state IN ('queued', 'running')
       AND (q.id IS NULL
            OR q.status NOT IN ('todo', 'doing')
            OR (q.status = 'doing'
                AND (w.id IS NULL OR w.last_heartbeat < now() - make_interval(secs => :silent_s))))
     ORDER BY j.queue_id LIMIT 100 FOR UPDATE OF j SKIP LOCKED
    """
)
_LEFT = text(
    """
    UPDATE procrastinate_jobs q SET status = 'failed'
     WHERE q.status = 'doing'
       AND NOT EXISTS (SELECT 1 FROM job j WHERE j.queue_id = q.id AND j.state IN ('queued', 'running'))
       AND NOT EXISTS (SELECT 1 FROM procrastinate_workers w
                        WHERE w.id = q.worker_id AND w.last_heartbeat >= now() - make_interval(secs => :silent_s))
    """
)
"""Ends deliveries whose worker died after the end of the job and before it marked the delivery as finished."""


@dataclass(frozen=True)
class Attempt:
    """One start of a job; ``row`` is the job's row at that moment."""

    job_id: str
    number: int
    kind: str
    row: Mapping[str, Any]

    @property
    def counted_starts(self) -> int:
        """Number of starts of the job including this one, without those that were handed back by a stopping worker."""
        return int(self.number - self.row["returned"])

    @property
    def blob_prefix(self) -> str:
        """Key prefix of the files of this attempt."""
        return f"results/{self.job_id}/{self.number}"


class AttemptStore:
    """Fenced state changes of jobs in one database."""

    def __init__(self, engine: AsyncEngine, kinds: Mapping[str, JobKind], *, max_attempts: int = 3) -> None:
        self._engine, self._kinds, self._max_attempts = engine, kinds, max_attempts

    async def start_attempt(self, delivery: queue.Delivery) -> Attempt | None:
        """Start the job; None if it does not wait for this delivery (any more).

        Safe to repeat after a connection broke during the commit: a delivery is held by one slot of one worker, so a
        job that runs with this delivery was started by the earlier call.
        """
        async with self._engine.begin() as connection:
            match_delivery = (job.c.id == delivery.job_id, job.c.queue_id == delivery.id)
            start_statement = (
                update(job)
                .where(*match_delivery, job.c.state == "queued")
                .values(state="running", attempt=job.c.attempt + 1, started_at=func.now(), fraction=0.0, message="")
                .returning(job)
            )
            row = (await connection.execute(start_statement)).mappings().one_or_none()
            if row is None:
                started = select(job).where(*match_delivery, job.c.state == "running")
                row = (await connection.execute(started)).mappings().one_or_none()
                return None if row is None else Attempt(row["id"], row["attempt"], row["kind"], dict(row))
            await emit_event(connection, delivery.job_id)
        return Attempt(row["id"], row["attempt"], row["kind"], dict(row))

    async def report_progress(self, attempt: Attempt, fraction: float, message: str) -> bool:
        """Write progress; False if the attempt should stop (cancelled, or superseded by another attempt)."""
        async with self._engine.begin() as connection:
            change = (
                _fenced_update(attempt)
                .where(~job.c.cancel_requested)
                .values(fraction=fraction, message=without_nul_characters(message))
            )
            return await _apply_change(connection, attempt, change)

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
            return await _apply_change(connection, attempt, change)

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
            return await _apply_change(connection, attempt, change)

    async def hand_back(self, attempt: Attempt, *, counts: bool = False) -> bool:
        """Queue the job again because its worker stops; this start does not count towards the maximum.

        ``counts`` is True if its process was killed from outside, so that a job that is killed every time fails.
        """
        async with self._engine.begin() as connection:
            mine = select(job.c.id).where(*_fencing_conditions(attempt)).with_for_update()
            if (await connection.execute(mine)).one_or_none() is None:
                return False
            queue_id = await self._redeliver(connection, attempt.row)
            change = _fenced_update(attempt).values(
                state="queued",
                returned=job.c.returned + (0 if counts else 1),
                queue_id=queue_id,
                started_at=None,
                fraction=0.0,
                message="its process was killed; waiting again" if counts else "waiting again",
            )
            return await _apply_change(connection, attempt, change)

    async def requeue_lost(self, silent_s: float | None) -> list[str]:
        """Queue lost jobs again; returns their ids.

        A queued or running job is lost if its delivery is missing, ended, or held by a worker that is not registered
        or, with ``silent_s``, has sent no heartbeat for that long. A job that was started too often fails instead.
        """
        async with self._engine.begin() as connection:
            if not (await connection.execute(select(func.pg_try_advisory_xact_lock(locks.REAPER)))).scalar_one():
                return []
            never = 10.0 * 365 * 86400
            silent = {"silent_s": never if silent_s is None else silent_s}
            await connection.execute(_LEFT, silent)
            result = await connection.execute(_LOST, silent)
            lost = list(result.scalars())
            for job_id in lost:
                row = (await connection.execute(select(job).where(job.c.id == job_id))).mappings().one()
                fate = await self._values_of_lost_job(connection, dict(row))
                await connection.execute(update(job).where(job.c.id == job_id).values(**fate))
                await emit_event(connection, job_id)
        return lost

    async def _values_of_lost_job(self, connection: AsyncConnection, row: Mapping[str, Any]) -> dict[str, Any]:
        """New column values of a lost job: cancelled, failed or queued again."""
        if row["cancel_requested"]:
            await queue.retire_delivery(connection, row["queue_id"])
            return {"state": "cancelled", "finished_at": func.now(), "message": "cancelled"}
        used = row["attempt"] - row["returned"]
        if row["state"] == "running" and used >= self._max_attempts:
            await queue.retire_delivery(connection, row["queue_id"])
            problem = {
                "code": "worker-died",
                "detail": f"The worker died {used} times while running this job.",
                "errors": [],
            }
            return {"state": "failed", "finished_at": func.now(), "message": "failed", "error": problem}
        again = await self._redeliver(connection, row)
        # a lost start does not count as the owner's turn (``queue_consumer``)
        waiting = {"state": "queued", "queue_id": again, "started_at": None, "fraction": 0.0}
        return {**waiting, "message": "its worker was lost; waiting again"}

    async def _redeliver(self, connection: AsyncConnection, row: Mapping[str, Any]) -> int:
        await queue.retire_delivery(connection, row["queue_id"])
        kind = self._kinds.get(row["kind"])
        return await queue.enqueue(connection, row["id"], kind.lane if kind else "short", row["priority"])


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
