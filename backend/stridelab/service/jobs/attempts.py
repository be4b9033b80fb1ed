"""State changes that workers make to a job. Number and time of the start are the fencing token.

A claim (``jobs.queue``) increments ``attempt`` and sets ``started_at``; every later write has the condition ``attempt =
mine AND started_at = mine AND state = 'running'``. The writes of a worker that was declared dead and resumes match no
row: it may repeat a computation, but publishes nothing. The same holds where the database was restored from an earlier
state, after which numbers repeat.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final, Literal

from sqlalchemy import ColumnElement, TextClause, bindparam, func, select, text
from sqlalchemy.dialects.postgresql import JSONB
from sqlalchemy.ext.asyncio import AsyncConnection, AsyncEngine

from stridelab.service.jobs.events import EVENT_COLUMNS, statement_with_events
from stridelab.service.jobs.partial_results import NumberedChunk, insert_chunks
from stridelab.service.jobs.queue import Attempt
from stridelab.service.kinds.base import JobKind, Json
from stridelab.service.kinds.provenance import software_versions
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
                          AND (last_heartbeat >= now() - make_interval(secs => :silent_s) OR EXISTS (
                              SELECT 1 FROM worker AS reaper WHERE reaper.id = CAST(:reaper AS bigint)
                                 AND reaper.last_heartbeat < now() - make_interval(secs => :silent_s / 2))))
     ORDER BY created_at LIMIT 100 FOR UPDATE SKIP LOCKED
    """
)
_FROM_THE_FUTURE = text("UPDATE worker SET last_heartbeat = now() WHERE last_heartbeat > now()")
"""After a clock was set back: a dead worker would seem alive until the clock has caught up with its last heartbeat."""


def _fenced_change(assignments: str, condition: str = "", *, ends_attempt: bool = True) -> TextClause:
    """Statement that changes the row of a running attempt, with its event; no row if the attempt is superseded."""
    same_start = "job.attempt = :attempt AND job.started_at IS NOT DISTINCT FROM CAST(:started_at AS timestamptz)"
    own = f"job.id = :job_id AND {same_start} AND state = 'running' {condition}"
    changed = f"UPDATE job SET {assignments} WHERE {own} RETURNING {EVENT_COLUMNS}"  # noqa: S608 (constants only)
    return statement_with_events(changed, ends_attempt=ends_attempt)


_NOT_CANCELLED: Final = "AND NOT cancel_requested"
_JSON: Final = JSONB(none_as_null=True)
_PROGRESS: Final = _fenced_change("fraction = :fraction, message = :message", _NOT_CANCELLED, ends_attempt=False)
_SUCCEED: Final = _fenced_change(
    "state = 'succeeded', fraction = 1, message = 'done', finished_at = now(), result = :result,"
    " blob_prefix = :blob_prefix, log_tail = :log_tail",
    _NOT_CANCELLED,
).bindparams(bindparam("result", type_=_JSON))
_END: Final = _fenced_change(
    "state = :state, message = :message, finished_at = now(), error = :error, result = :result,"
    " blob_prefix = :blob_prefix, log_tail = :log_tail"
).bindparams(bindparam("error", type_=_JSON), bindparam("result", type_=_JSON))
_WAIT_AGAIN: Final = _fenced_change(  # a start without started_at is no turn of its owner (jobs.queue)
    "state = 'queued', worker_id = NULL, started_at = NULL, fraction = 0, returned = job.returned + :returned,"
    " message = :message"
)
_OUTCOME: Final = text("SELECT state, attempt, started_at, error, blob_prefix FROM job WHERE id = :job_id")


class AttemptStore:
    """Fenced state changes of jobs in one database."""

    def __init__(self, engine: AsyncEngine, kinds: Mapping[str, JobKind], *, max_attempts: int = 3) -> None:
        self._engine, self._kinds, self._max_attempts = engine, kinds, max_attempts

    async def report_progress(
        self, attempt: Attempt, fraction: float, message: str, chunks: Sequence[NumberedChunk] = ()
    ) -> bool:
        """Write progress and new parts; False if the attempt should stop (cancelled, or superseded by another)."""
        async with self._engine.begin() as connection:
            progress = {"fraction": fraction, "message": without_nul_characters(message)}
            if not await _apply_change(connection, _PROGRESS, attempt, progress):
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
        publish = self._kinds[attempt.kind].publish
        async with (publication or Publication()).transaction(self._engine) as connection:
            summary = outcome["summary"]
            if publish is not None:
                row = await _lock_running_row(connection, attempt)
                if row is not None:
                    summary = await publish(connection, blobs, row, outcome, folder) or summary
            values = {
                "result": without_nul_characters(_result_record(summary, outcome, artifacts)),
                "blob_prefix": attempt.blob_prefix,
                "log_tail": without_nul_characters(log_tail),
            }
            if await _apply_change(connection, _SUCCEED, attempt, values):
                return True
            # True if an earlier call of this attempt has committed
            return await _read_outcome(connection, attempt) == ("succeeded", None, attempt.blob_prefix)

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
        values: dict[str, Any] = {
            "state": state,
            "message": state.replace("_", " "),
            "error": without_nul_characters(problem),
            "result": None,
            "blob_prefix": None,
            "log_tail": without_nul_characters(log_tail),
        }
        if partial_result is not None:
            outcome, artifacts = partial_result
            values["result"] = without_nul_characters(_result_record(outcome["summary"], outcome, artifacts))
            values["blob_prefix"] = attempt.blob_prefix
        async with (publication or Publication()).transaction(self._engine) as connection:
            if await _apply_change(connection, _END, attempt, values):
                return True
            # True if an earlier call of this attempt has committed the same end
            ours = (values["state"], values["error"], values["blob_prefix"])
            return await _read_outcome(connection, attempt) == ours

    async def hand_back(self, attempt: Attempt, *, counts: bool = False) -> bool:
        """Queue the job again because its worker stops; this start does not count towards the maximum.

        ``counts`` is True if its process was killed from outside, so that a job that is killed every time fails.
        """
        message = "its process was killed; waiting again" if counts else "waiting again"
        async with self._engine.begin() as connection:
            values = {"returned": 0 if counts else 1, "message": message}
            return await _apply_change(connection, _WAIT_AGAIN, attempt, values)

    async def requeue_lost(self, silent_s: float | None, reaper: int | None = None) -> list[str]:
        """Queue lost jobs again; returns their ids.

        A running job is lost if its worker is not registered or, with ``silent_s``, has sent no heartbeat for that
        long. A job that was started too often fails instead. ``reaper`` is the worker that calls and has just sent its
        own heartbeat: if that is old, the clock of the database has jumped since, and no worker is silent.
        """
        async with self._engine.begin() as connection:
            if not (await connection.execute(select(func.pg_try_advisory_xact_lock(locks.REAPER)))).scalar_one():
                return []
            await connection.execute(_FROM_THE_FUTURE)
            never = 10.0 * 365 * 86400
            limits = {"silent_s": never if silent_s is None else silent_s, "reaper": reaper}
            lost = await connection.execute(_LOST, limits)
            attempts = [Attempt(row["id"], row["attempt"], row["kind"], dict(row)) for row in lost.mappings()]
            for attempt in attempts:
                await _apply_change(connection, *self._end_of_lost(attempt))
        return [attempt.job_id for attempt in attempts]

    def _end_of_lost(self, attempt: Attempt) -> tuple[TextClause, Attempt, dict[str, Any]]:
        """Arguments of ``_apply_change`` for a lost job: it is cancelled, fails, or waits again."""
        n_starts = attempt.counted_starts
        if not attempt.row["cancel_requested"] and n_starts < self._max_attempts:
            return _WAIT_AGAIN, attempt, {"returned": 0, "message": "its worker was lost; waiting again"}
        state = "cancelled" if attempt.row["cancel_requested"] else "failed"
        detail = f"The worker died {n_starts} times while running this job."
        problem = {"code": "worker-died", "detail": detail, "errors": []}
        empty = {"result": None, "blob_prefix": None, "log_tail": None}
        error = problem if state == "failed" else None
        return _END, attempt, {**empty, "state": state, "message": state, "error": error}


def _result_record(summary: Json, outcome: Json, artifacts: list[Json]) -> Json:
    """The result that is stored in the row of a job."""
    references = list(outcome["references"])
    return {"summary": summary, "references": references, "versions": software_versions(), "artifacts": artifacts}


async def _lock_running_row(connection: AsyncConnection, attempt: Attempt) -> Mapping[str, Any] | None:
    """The row of a running attempt, locked until the end of the transaction; None if superseded or cancelled."""
    own = select(job).where(*_fencing_conditions(attempt), ~job.c.cancel_requested).with_for_update()
    row = (await connection.execute(own)).mappings().one_or_none()
    return None if row is None else dict(row)


def _fencing_conditions(attempt: Attempt) -> tuple[ColumnElement[bool], ...]:
    return (
        job.c.id == attempt.job_id,
        job.c.attempt == attempt.number,
        job.c.started_at == attempt.started_at,
        job.c.state == "running",
    )


async def _apply_change(
    connection: AsyncConnection, change: TextClause, attempt: Attempt, values: Mapping[str, Any]
) -> bool:
    """Execute a ``_fenced_change``; False if the attempt is superseded."""
    own = {"job_id": attempt.job_id, "attempt": attempt.number, "started_at": attempt.started_at}
    return (await connection.execute(change, {**own, **values})).first() is not None


async def _read_outcome(connection: AsyncConnection, attempt: Attempt) -> tuple[str, Any, str | None] | None:
    """State, error and prefix of the files of the job; None if the attempt is superseded by another."""
    row = (await connection.execute(_OUTCOME, {"job_id": attempt.job_id})).one_or_none()
    if row is None or (row.attempt, row.started_at) != (attempt.number, attempt.started_at):
        return None
    return row.state, row.error, row.blob_prefix


def without_nul_characters(value: Any) -> Any:
    """Remove NUL characters, which PostgreSQL's text and JSON types do not accept, from a JSON value."""
    if isinstance(value, str):
        return value.replace("\0", "")
    if isinstance(value, Mapping):
        return {without_nul_characters(key): without_nul_characters(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [without_nul_characters(item) for item in value]
    return value
