"""Endpoints of jobs: list, wait, follow, cancel, delete, and download of results."""

from collections.abc import Sequence
from typing import Annotated, Any, Final

import structlog
from fastapi import APIRouter, Header, Query
from pydantic import StringConstraints
from starlette.responses import Response, StreamingResponse

from stridelab.errors import NotFound
from stridelab.schemas.base import Page
from stridelab.schemas.jobs import Job, JobResult, JobState
from stridelab.schemas.previews import PartialResults
from stridelab.service.api.dependencies import AppParts, CallerOf, Parts, require_id_form
from stridelab.service.api.downloads import OCTETS, send_blob
from stridelab.service.api.jobs import bundle, delete, events
from stridelab.service.api.jobs.presentation import job_of
from stridelab.service.api.jobs.submit import add_kinds
from stridelab.service.api.openapi import failure_responses, file_response
from stridelab.service.api.pagination import Cursor, Limit, Search
from stridelab.service.api.shutdown import await_unless
from stridelab.service.api.strict_json import StrictRoute
from stridelab.service.auth import audit
from stridelab.service.auth.callers import require_owner
from stridelab.service.jobs.store import JobRecord

router = APIRouter(prefix="/jobs", tags=["jobs"], route_class=StrictRoute)

Wait = Annotated[float, Query(ge=0, le=60, description="seconds to wait for the job to finish")]
IdText = Annotated[str, StringConstraints(max_length=64, pattern=r"^[A-Za-z0-9_-]*$")]
Text = Annotated[IdText | None, Query()]
ScenarioIds = Annotated[
    Sequence[IdText], Query(max_length=50, description="only jobs of this scenario; may be repeated for several")
]

_UNKNOWN: Final = failure_responses(s404="No job with this id (`job-not-found`).")
_NO_RESULT: Final = failure_responses(
    s404="No job with this id (`job-not-found`).",
    s409="The job has not finished (`job-not-finished`), or ended without a result (`job-without-result`).",
)
_STREAM: Final[dict[int | str, dict[str, Any]]] = {
    200: {
        "description": "Events `progress` and `state`; `id` is the event number to resume from, `data` is a JobEvent.",
        "content": {"text/event-stream": {"schema": {"type": "string"}}},
    }
}


@router.get("", summary="List jobs")
async def list_jobs(
    parts: AppParts,
    limit: Limit = 50,
    cursor: Cursor = None,
    state: Annotated[JobState | None, Query(description="only jobs in this state")] = None,
    kind: Text = None,
    recording_id: Text = None,
    scenario_id: ScenarioIds = (),
    one_per_scenario: Annotated[bool, Query(description="of each scenario only the newest of these jobs")] = False,
    search: Search = None,
) -> Page[Job]:
    """List jobs, newest first, optionally of one state, kind, recording, or of some scenarios.

    `search` looks in the kind and in the names of the recording and the scenario.
    """
    page = await parts.store.list_jobs(
        limit=limit,
        cursor=cursor or None,
        state=state,
        kind=kind or None,
        recording_id=recording_id or None,
        scenario_ids=[one for one in scenario_id if one],
        one_per_scenario=one_per_scenario,
        search=search,
    )
    return Page[Job](items=[job_of(record) for record in page.items], next=page.next)


@router.get("/{job_id}", summary="One job", responses=_UNKNOWN)
async def get_job(parts: AppParts, job_id: str, wait: Wait = 0.0) -> Job:
    """State and progress of a job. With `wait`, responds when the job has finished, or after that time."""
    record = await _job_record(parts, job_id)
    if wait > 0 and not record.is_final:
        record = (
            await await_unless(parts.closing, parts.notifications.wait_for_end(parts.store, job_id, wait)) or record
        )
    return job_of(record)


@router.delete(
    "/{job_id}",
    summary="Cancel or delete a job",
    responses={
        **_UNKNOWN,
        **failure_responses(
            s409="A bundled result (`bundled-read-only`), or a recording refers to it (`job-holds-truth`)."
        ),
    },
)
async def cancel_job(
    parts: AppParts,
    caller: CallerOf,
    job_id: str,
    cancel_only: Annotated[bool, Query(description="leave a finished job as it is")] = False,
) -> Job:
    """Cancel one's own job, or delete it if it has finished; returns the last state of the job.

    A queued job is cancelled at once, a running one within half a second. A finished one is deleted with its result
    and files, unless `cancel_only` is set.
    """
    record = await _job_record(parts, job_id)
    require_owner(caller, record.owner, "job")
    if record.is_final:
        if not cancel_only:
            await delete.delete_finished(parts, record.id, caller)
        return job_of(record)
    async with parts.engine.begin() as connection:
        await audit.record_action(connection, caller, "job-cancelled", job_id)
    cancelled = await parts.store.request_cancel(job_id)
    await delete.remove_own_files(parts, cancelled)
    return job_of(cancelled)


@router.get(
    "/{job_id}/events",
    summary="Follow a job",
    responses={**_UNKNOWN, **_STREAM},
    response_class=StreamingResponse,
)
async def job_events(
    parts: AppParts,
    job_id: str,
    last_event_id: Annotated[
        str | None, Header(alias="Last-Event-ID", max_length=20, description="number of the last event seen")
    ] = None,
) -> StreamingResponse:
    """Server-sent events, from the first one or from the one after `Last-Event-ID`, until the job has finished."""
    await _job_record(parts, job_id)
    return events.stream_events(parts, job_id, events.resume_from(last_event_id))


@router.get("/{job_id}/partial", summary="Parts of the result of a running job", responses=_UNKNOWN)
async def get_partial(
    response: Response,
    parts: AppParts,
    job_id: str,
    after: Annotated[
        str | None, Query(max_length=25, description="`next` of an earlier response; null reads from the first part")
    ] = None,
) -> PartialResults:
    """What a running job has computed so far, for a first look: parts are no result and may be replaced by it.

    Only `plan-motion` has parts. Progress events announce new ones. A queued or finished job has none.
    """
    response.headers["Cache-Control"] = "no-store"
    return await parts.store.partial_results(require_id_form(job_id, "job"), after)


@router.get("/{job_id}/result", summary="Result of a job", responses=_NO_RESULT)
async def get_result(parts: AppParts, job_id: str) -> JobResult:
    """Input, summary, versions, references (BibTeX keys) and the list of files of a succeeded job."""
    await _job_record(parts, job_id)
    return await parts.store.result(job_id)


@router.get(
    "/{job_id}/artifacts/{name}",
    summary="One file of a result",
    responses={
        **_NO_RESULT,
        **file_response("The file.", OCTETS),
        **failure_responses(
            s404="No such job (`job-not-found`), or no such file in its result (`artifact-not-found`)."
        ),
    },
    response_class=StreamingResponse,
)
async def get_artifact(parts: AppParts, job_id: str, name: str) -> StreamingResponse:
    """Download one file of a succeeded job, by its name in the result."""
    record = await _job_record(parts, job_id)
    result = await parts.store.result(job_id)
    for artifact in result.artifacts:
        if artifact.name == name:
            key = f"{record.blob_prefix}/{artifact.name}"
            return await send_blob(parts, key, artifact.name, artifact.media_type, n_bytes=artifact.bytes)
    names = ", ".join(artifact.name for artifact in result.artifacts) or "none"
    raise NotFound("artifact-not-found", f"The result has no file of that name; it has: {names}.")


@router.get(
    "/{job_id}/bundle.zip",
    summary="Everything about a job",
    responses={**_NO_RESULT, **file_response("The archive.", "application/zip")},
    response_class=StreamingResponse,
)
async def get_bundle(parts: AppParts, job_id: str) -> StreamingResponse:
    """Archive with input, result, versions, references.bib and all files of a succeeded job, and the recording."""
    return await bundle.stream_bundle(parts, await _job_record(parts, job_id), await parts.store.result(job_id))


add_kinds(router)


async def _job_record(parts: Parts, job_id: str) -> JobRecord:
    record = await parts.store.get(require_id_form(job_id, "job"))
    structlog.contextvars.bind_contextvars(job_id=record.id)
    return record
