"""The client's view of jobs: submit, query, cancel. The ``job`` row holds the state and waits in the queue.

States: ``queued -> running -> succeeded | failed | cancelled | timed_out``, ``queued -> cancelled``, and
``running -> queued`` after the loss of a worker. Every change writes the row, an event and a NOTIFY in one transaction;
``attempts`` contains the state changes made by workers.
"""

import hashlib
import json
import uuid
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Any, Final

import psycopg
from sqlalchemy import Select, and_, bindparam, case, column, func, literal, or_, select, tuple_, update
from sqlalchemy.dialects.postgresql import JSONB, distinct_on
from sqlalchemy.exc import IntegrityError
from sqlalchemy.ext.asyncio import AsyncConnection, AsyncEngine

from stridelab.errors import Busy, Conflict, Fault, InvalidInput, NotFound
from stridelab.schemas.jobs import FINAL_STATES, Artifact, JobEvent, JobResult, JobState
from stridelab.schemas.previews import PartialResults
from stridelab.service import telemetry
from stridelab.service.cursors import decode_cursor, encode_cursor
from stridelab.service.jobs.events import CANCEL_CHANNEL, EVENT_COLUMNS, emit_event, statement_with_events
from stridelab.service.jobs.partial_results import decode_partial_cursor, read_chunks
from stridelab.service.jobs.progress_words import progress_of
from stridelab.service.jobs.queue_positions import QueuePositions
from stridelab.service.jobs.verdict import VERDICT_FIELDS
from stridelab.service.kinds.base import JobKind
from stridelab.service.storage import locks
from stridelab.service.storage.database import connect_autocommit
from stridelab.service.storage.search import contains_words
from stridelab.service.storage.tables import job, job_event, recording, scenario

POOLING_KINDS: Final = ("gait-measures", "gait-report")
"""Kinds whose jobs on several recordings are also listed with each of them."""
_MAX_PRIORITY: Final = 100
_RETRY_AFTER_S: Final = 5.0


@dataclass(frozen=True)
class JobRecord:
    """Current state of a job, without its result.

    ``error`` is ``{"code", "detail", "errors": [{"where", "message"}]}``.
    ``verdict_parts`` are the fields of the summary that the verdict is derived from, None unless the job succeeded;
    ``subject_name`` is the file name of its recording, or the name of its stored scenario.
    """

    id: str
    kind: str
    state: JobState
    priority: int
    attempt: int
    owner: str | None
    recording_id: str | None
    scenario_id: str | None
    input: dict[str, Any]
    fraction: float
    message: str
    cancel_requested: bool
    created_at: datetime
    started_at: datetime | None
    finished_at: datetime | None
    error: dict[str, Any] | None
    has_result: bool
    verdict_parts: dict[str, Any] | None
    subject_name: str | None
    blob_prefix: str | None
    log_tail: str | None
    queue_position: int | None

    @property
    def is_final(self) -> bool:
        """Whether the state is final."""
        return self.state in FINAL_STATES


@dataclass(frozen=True)
class Submission:
    """Result of a submission; ``created`` is False if the idempotency key matches an earlier job."""

    job_id: str
    created: bool


@dataclass(frozen=True)
class JobPage:
    """A page of jobs, newest first, and the cursor of the next page."""

    items: tuple[JobRecord, ...]
    next: str | None


_ADD_JOB: Final = statement_with_events(
    f"""
    WITH waiting AS MATERIALIZED (SELECT * FROM count_waiting_jobs(:admission_lock, :owner))
    INSERT INTO job (id, owner, kind, lane, priority, input, input_hash, idempotency_key, recording_id, scenario_id,
                     traceparent)
    SELECT :id, :owner, :kind, :lane, :priority, :input, :input_hash, :idempotency_key, :recording_id, :scenario_id,
           :traceparent
      FROM waiting
     WHERE n_waiting < :queue_limit
       AND (CAST(:owner AS text) IS NULL OR :user_queue_limit = 0 OR n_of_submitter < :user_queue_limit)
    ON CONFLICT DO NOTHING RETURNING {EVENT_COLUMNS}
    """  # noqa: S608 (constants only)
).bindparams(bindparam("input", type_=JSONB))
"""Adds a job unless the queue is full or the idempotency key is used: one round trip, so that a busy event loop never
holds the lock of admission while others wait for it."""


class JobStore:
    """Job operations of the web layer. Invalid requests raise ``StridelabError`` only."""

    def __init__(
        self,
        engine: AsyncEngine,
        kinds: Mapping[str, JobKind],
        *,
        queue_limit: int = 200,
        user_queue_limit: int = 0,
        max_position_age_s: float = 0.0,
    ) -> None:
        self._engine, self._kinds = engine, kinds
        self._positions = QueuePositions(engine, max_position_age_s)
        self._queue_limit, self._user_queue_limit = queue_limit, user_queue_limit

    async def submit(
        self,
        kind: str,
        input: dict[str, Any],  # noqa: A002 (the contract's word)
        *,
        owner: str | None = None,
        priority: int = 0,
        idempotency_key: str | None = None,
        recording_id: str | None = None,
        scenario_id: str | None = None,
    ) -> Submission:
        """Submit a job with validated ``input``: row and event in one transaction.

        Raises ``NotFound`` (``unknown-job-kind``, ``recording-not-found``, ``scenario-not-found``), ``InvalidInput``
        (``priority-out-of-range``, ``idempotency-key-invalid``), ``Conflict`` (``idempotency-key-reused``) where the
        key was used with another input, ``Busy`` (``queue-full``, ``user-queue-full``).
        """
        if kind not in self._kinds:
            raise NotFound("unknown-job-kind", f"There is no job kind {kind!r}; there are {', '.join(self._kinds)}.")
        if abs(priority) > _MAX_PRIORITY:
            raise InvalidInput(
                "priority-out-of-range",
                f"The priority must lie between -{_MAX_PRIORITY} and {_MAX_PRIORITY}.",
                [Fault("priority", str(priority))],
            )
        if idempotency_key is not None and not (0 < len(idempotency_key) <= 200 and idempotency_key.isprintable()):
            raise InvalidInput("idempotency-key-invalid", "An idempotency key has 1 to 200 printable characters.")
        job_id, body_hash = uuid.uuid4().hex, input_hash(kind, input)
        row = {
            "admission_lock": locks.ADMISSION,
            "queue_limit": self._queue_limit,
            "user_queue_limit": self._user_queue_limit,
            "id": job_id,
            "owner": owner,
            "kind": kind,
            "lane": self._kinds[kind].lane,
            "priority": priority,
            "input": input,
            "input_hash": body_hash,
            "idempotency_key": idempotency_key,
            "recording_id": recording_id,
            "scenario_id": scenario_id,
            "traceparent": telemetry.current_traceparent(),
        }
        try:
            async with connect_autocommit(self._engine) as connection:
                while True:
                    if idempotency_key is not None:
                        earlier = await self._find_by_idempotency_key(connection, owner, idempotency_key, body_hash)
                        if earlier is not None:
                            return Submission(earlier, created=False)
                    if (await connection.execute(_ADD_JOB, row)).all():
                        return Submission(job_id, created=True)
                    # another request has just used the key, or the queue is full; unless it has become shorter since
                    await self._check_queue_limits(connection, owner)
        except IntegrityError as error:
            raise _unknown_reference(error, recording_id, scenario_id) from error

    async def get(self, job_id: str) -> JobRecord:
        """One job; raises ``NotFound`` (``job-not-found``)."""
        async with connect_autocommit(self._engine) as connection:
            row = (await connection.execute(_JOB_BY_ID, {"job_id": job_id})).mappings().one_or_none()
        if row is None:
            raise _unknown_job(job_id)
        (record,) = await self._records_of([row])
        return record

    async def list_jobs(
        self,
        *,
        limit: int = 50,
        cursor: str | None = None,
        state: str | None = None,
        kind: str | None = None,
        recording_id: str | None = None,
        scenario_ids: Sequence[str] = (),
        one_per_scenario: bool = False,
        search: str | None = None,
    ) -> JobPage:
        """Jobs, newest first; ``search`` looks in the kind and in the names of recording and scenario.

        Those of a recording include the measures and reports of gait of several recordings of which it is one.
        ``one_per_scenario`` leaves only the newest job of each scenario.

        Raises ``InvalidInput`` (``invalid-cursor``).
        """
        conditions = [job.c[name] == value for name, value in (("state", state), ("kind", kind)) if value is not None]
        if recording_id is not None:
            pooled = and_(job.c.kind.in_(POOLING_KINDS), job.c.input["recording_ids"].contains([recording_id]))
            conditions.append(or_(job.c.recording_id == recording_id, pooled))
        if scenario_ids:
            conditions.append(job.c.scenario_id.in_(scenario_ids))
        if search is not None:
            conditions.append(contains_words(search, job.c.kind, _RECORDING_NAME, _SCENARIO_NAME))
        newest_first = (job.c.created_at.desc(), job.c.id.desc())
        if one_per_scenario:
            newest = select(job.c.id).where(job.c.scenario_id.is_not(None), *conditions)
            newest = newest.order_by(job.c.scenario_id, *newest_first).ext(distinct_on(job.c.scenario_id))
            conditions = [job.c.id.in_(newest.correlate(None))]
        wanted = _JOBS_SELECT.where(*conditions).order_by(*newest_first).limit(limit + 1)
        if cursor is not None:
            at, job_id = decode_cursor(cursor)
            wanted = wanted.where(tuple_(job.c.created_at, job.c.id) < tuple_(literal(at), literal(job_id)))
        async with connect_autocommit(self._engine) as connection:
            rows = (await connection.execute(wanted)).mappings().all()
        more = len(rows) > limit
        items = await self._records_of(rows[:limit])
        return JobPage(items, encode_cursor(items[-1].created_at, items[-1].id) if more else None)

    async def request_cancel(self, job_id: str) -> JobRecord:
        """Cancel a queued job at once, or request the worker of a running one to stop; no effect on a finished job.

        Raises ``NotFound`` (``job-not-found``).
        """
        async with self._engine.begin() as connection:
            locked = select(job.c.state).where(job.c.id == job_id).with_for_update()
            state = (await connection.execute(locked)).scalar_one_or_none()
            change = update(job).where(job.c.id == job_id)
            if state == "queued":
                await connection.execute(
                    change.values(state="cancelled", cancel_requested=True, finished_at=func.now(), message="cancelled")
                )
                await emit_event(connection, job_id)
            elif state == "running":
                await connection.execute(change.values(cancel_requested=True, message="cancelling"))
                await connection.execute(select(func.pg_notify(CANCEL_CHANNEL, job_id)))
                await emit_event(connection, job_id)
        return await self.get(job_id)

    async def events_after(self, job_id: str, seq: int = 0, *, limit: int = 500) -> tuple[JobEvent, ...]:
        """The job's events with a number above ``seq``, in order."""
        wanted = select(job_event).where(job_event.c.job_id == job_id, job_event.c.seq > seq)
        async with connect_autocommit(self._engine) as connection:
            rows = (await connection.execute(wanted.order_by(job_event.c.seq).limit(limit))).all()
        return tuple(JobEvent.from_object(row, progress=progress_of(row.fraction, row.message)) for row in rows)

    async def partial_results(self, job_id: str, cursor: str | None) -> PartialResults:
        """Parts of the result of a running job that follow ``cursor``; none unless it runs.

        Raises ``NotFound`` (``job-not-found``), ``InvalidInput`` (``invalid-cursor``).
        """
        attempt, after = decode_partial_cursor(cursor)
        async with connect_autocommit(self._engine) as connection:
            wanted = select(job.c.state, job.c.attempt).where(job.c.id == job_id)
            row = (await connection.execute(wanted)).one_or_none()
            if row is None:
                raise _unknown_job(job_id)
            after = after if attempt == row.attempt else 0
            chunks, last = await read_chunks(connection, job_id, row.attempt, after)
        cursor = f"{row.attempt}.{last}"
        return PartialResults(job_id=job_id, state=row.state, attempt=row.attempt, chunks=chunks, next=cursor)

    async def result(self, job_id: str) -> JobResult:
        """The result of a succeeded job.

        Raises ``NotFound`` (``job-not-found``), ``Conflict`` (``job-not-finished``, ``job-without-result``).
        """
        wanted = select(job.c.state, job.c.kind, job.c.input, job.c.result).where(job.c.id == job_id)
        async with connect_autocommit(self._engine) as connection:
            row = (await connection.execute(wanted)).one_or_none()
        if row is None:
            raise _unknown_job(job_id)
        if row.state not in FINAL_STATES:
            raise Conflict("job-not-finished", f"Job {job_id} is still {row.state}; it has no result yet.")
        if row.result is None:
            raise Conflict("job-without-result", f"Job {job_id} ended as {row.state} and has no result.")
        return JobResult(
            kind=row.kind,
            input=row.input,
            versions=row.result["versions"],
            references=row.result["references"],
            summary=row.result["summary"],
            artifacts=[Artifact(**artifact) for artifact in row.result["artifacts"]],
        )

    async def _records_of(self, rows: Sequence[Mapping[Any, Any]]) -> tuple[JobRecord, ...]:
        waiting = [row["id"] for row in rows if row["state"] == "queued"]
        places = await self._positions.positions_of(waiting)
        return tuple(
            JobRecord(**row, queue_position=places.get(row["id"]) if row["state"] == "queued" else None) for row in rows
        )

    async def _find_by_idempotency_key(
        self, connection: AsyncConnection, owner: str | None, idempotency_key: str, body_hash: str
    ) -> str | None:
        wanted = select(job.c.id, job.c.input_hash).where(
            job.c.owner.is_not_distinct_from(owner), job.c.idempotency_key == idempotency_key
        )
        row = (await connection.execute(wanted)).mappings().one_or_none()
        if row is None:
            return None
        if row["input_hash"] != body_hash:
            raise Conflict(
                "idempotency-key-reused",
                f"This Idempotency-Key was used for another request (job {row['id']}); use a new key.",
                [Fault("Idempotency-Key", "already used for another request")],
            )
        return str(row["id"])

    async def _check_queue_limits(self, connection: AsyncConnection, owner: str | None) -> None:
        waiting = (await connection.execute(select(func.count()).where(job.c.state == "queued"))).scalar_one()
        if waiting >= self._queue_limit:
            raise Busy(
                "queue-full",
                f"{waiting} jobs are waiting already, which is the limit. Try again in a few seconds.",
                _RETRY_AFTER_S,
            )
        if owner is None or self._user_queue_limit == 0:
            return
        own = select(func.count()).where(job.c.state == "queued", job.c.owner == owner)
        waiting = (await connection.execute(own)).scalar_one()
        if waiting >= self._user_queue_limit:
            raise Busy(
                "user-queue-full",
                f"{waiting} of your jobs are waiting already, which is the limit for one user. Try again later.",
                _RETRY_AFTER_S,
            )


def input_hash(kind: str, input: Mapping[str, Any]) -> str:  # noqa: A002 (the contract's word)
    """SHA-256 of a job's kind and input, independent of the order of keys."""
    canonical = json.dumps([kind, input], sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(canonical.encode()).hexdigest()


def _unknown_job(job_id: str) -> NotFound:
    return NotFound("job-not-found", f"There is no job {job_id}; its retention time may have expired.")


def _unknown_reference(error: IntegrityError, recording_id: str | None, scenario_id: str | None) -> NotFound:
    violated = error.orig.diag.constraint_name if isinstance(error.orig, psycopg.Error) else None
    what, named = ("scenario", scenario_id) if violated == "job_scenario_id_fkey" else ("recording", recording_id)
    return NotFound(f"{what}-not-found", f"There is no {what} {named}.", [Fault(f"{what}_id", "unknown")])


_RECORDING_NAME: Final = select(recording.c.filename).where(recording.c.id == job.c.recording_id).scalar_subquery()
_SCENARIO_NAME: Final = (
    select(scenario.c.body["name"].astext).where(scenario.c.id == job.c.scenario_id).scalar_subquery()
)


def _select_records() -> Select[Any]:
    """Select the columns of ``JobRecord`` but for the queue position."""
    # results can be long: each is decompressed once, and a list needs only what the verdicts depend on
    field = func.jsonb_each(job.c.result["summary"]).table_valued("key", column("value", JSONB))
    parts = select(func.jsonb_object_agg(field.c.key, field.c.value)).where(field.c.key.in_(VERDICT_FIELDS))
    return select(
        *(one for one in job.c if one.name in JobRecord.__dataclass_fields__),
        job.c.result.is_not(None).label("has_result"),
        case((job.c.state == "succeeded", parts.scalar_subquery())).label("verdict_parts"),
        func.coalesce(_RECORDING_NAME, _SCENARIO_NAME).label("subject_name"),
    )


# built once: building the statement costs more than executing it
_JOBS_SELECT: Final = _select_records()
_JOB_BY_ID: Final = _JOBS_SELECT.where(job.c.id == bindparam("job_id"))
