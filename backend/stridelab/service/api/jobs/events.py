"""Resumable server-sent events of a job."""

from collections.abc import AsyncIterator
from contextlib import aclosing
from typing import Final

import structlog
from sqlalchemy.exc import DBAPIError
from starlette.responses import StreamingResponse

from stridelab.errors import Fault, InvalidInput, StridelabError
from stridelab.schemas.jobs import FINAL_STATES, JobEvent, JobState
from stridelab.service.api.dependencies import Parts
from stridelab.service.jobs.progress_words import progress_of
from stridelab.service.jobs.store import JobRecord

log = structlog.get_logger(__name__)

_MAX_EVENT_ID: Final = 2**63 - 1


def resume_from(last_event_id: str | None) -> int:
    """Event number after which a stream starts; 0 without ``last_event_id``.

    Raises ``InvalidInput`` (``invalid-event-id``).
    """
    if not last_event_id:
        return 0
    if not (last_event_id.isascii() and last_event_id.isdecimal() and int(last_event_id) <= _MAX_EVENT_ID):
        raise InvalidInput(
            "invalid-event-id",
            "Last-Event-ID must be the number of an event of this job.",
            [Fault("Last-Event-ID", "not an event number")],
        )
    return int(last_event_id)


def stream_events(parts: Parts, job_id: str, after: int) -> StreamingResponse:
    """Stream the job's events with numbers above ``after`` until it has finished."""
    headers = {"Cache-Control": "no-cache, no-transform", "X-Accel-Buffering": "no"}
    return StreamingResponse(_event_lines(parts, job_id, after), media_type="text/event-stream", headers=headers)


async def _event_lines(parts: Parts, job_id: str, after: int) -> AsyncIterator[str]:
    state: JobState | None = None
    yield ": following\n\n"
    try:
        async with aclosing(parts.notifications.follow_events(parts.store, job_id, after, parts.closing)) as changes:
            async for events in changes:
                lines = []
                for event in events:
                    after = event.seq
                    lines.append(_format_event(event, changed=event.state != state))
                    state = event.state
                yield "".join(lines) or ": nothing new\n\n"
        record = await parts.store.get(job_id)
        if record.is_final and state not in FINAL_STATES:
            yield _format_event(_final_event(record, after), changed=True)
    except (StridelabError, DBAPIError) as error:
        # The job was deleted or the database is restarting. The response has started, so it can only end here; a
        # client that resumes receives the error.
        log.warning("event stream ended early", error=type(error).__name__)


def _format_event(event: JobEvent, *, changed: bool) -> str:
    name = "state" if changed else "progress"
    return f"id: {event.seq}\nevent: {name}\ndata: {event.model_dump_json()}\n\n"


def _final_event(record: JobRecord, seq: int) -> JobEvent:
    """Final event of a finished job whose stored events do not contain its final state any more."""
    return JobEvent(
        seq=seq,
        at=record.finished_at or record.created_at,
        state=record.state,
        attempt=record.attempt,
        progress=progress_of(record.fraction, record.message),
    )
