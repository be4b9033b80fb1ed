"""The lists of recordings, jobs and subjects, and the page of one subject with the recordings of that person."""

from collections.abc import Sequence
from typing import Final

from starlette.requests import Request
from starlette.responses import Response

from stridelab.client import AsyncClient
from stridelab.schemas.jobs import Job
from stridelab_web.api_client import client_of, none_if_missing
from stridelab_web.formatting import KINDS
from stridelab_web.formatting import job_kind_name as name_of
from stridelab_web.pages.render import render_page

OFFERED: Final = 50
"""Number of recordings without a subject that are offered at a time."""


async def subjects_page(request: Request) -> Response:
    """``GET /subjects``."""
    listed = await client_of(request).subjects(cursor=request.query_params.get("cursor"))
    return render_page(request, "pages/subjects.html", section="Subjects", subjects=listed.items, next=listed.next)


async def subject_page(request: Request) -> Response:
    """``GET /subjects/{id}``; ``cursor=`` and ``others=`` select later pages of both lists of recordings."""
    client, query = client_of(request), request.query_params
    subject = await client.subject(request.path_params["id"])
    own = await client.recordings(cursor=query.get("cursor"), subject_id=subject.subject_id)
    others = await client.recordings(limit=OFFERED, cursor=query.get("others"), linked=False)
    return render_page(
        request,
        "pages/subject.html",
        section="Subjects",
        subject=subject,
        recordings=own.items,
        next=own.next,
        others=[item for item in others.items if not item.bundled],
        next_others=others.next,
        paged="others" in query,
    )


async def recordings_page(request: Request) -> Response:
    """``GET /recordings``."""
    listed = await client_of(request).recordings(cursor=request.query_params.get("cursor"))
    return render_page(
        request, "pages/recordings.html", section="Recordings", recordings=listed.items, next=listed.next
    )


async def jobs_page(request: Request) -> Response:
    """``GET /jobs?state=&kind=``: all jobs, or those of one state, one kind or both."""
    client, query = client_of(request), request.query_params
    state, kind = query.get("state", ""), query.get("kind", "")
    listed = await client.jobs(state=state or None, kind=kind or None, cursor=query.get("cursor"))
    return render_page(
        request,
        "pages/jobs.html",
        section="Jobs",
        jobs=listed.items,
        next=listed.next,
        state_filter=state,
        kind_filter=kind,
        kinds=sorted({*KINDS, *(job.kind for job in listed.items), kind} - {""}, key=name_of),
        filenames=await filenames_of(client, listed.items),
    )


async def filenames_of(client: AsyncClient, jobs: Sequence[Job]) -> dict[str, str]:
    """File names of the recordings of the jobs, by recording id; deleted recordings are left out."""
    names: dict[str, str] = {}
    for recording_id in {job.recording_id for job in jobs if job.recording_id is not None}:
        if recording := await none_if_missing(client.recording(recording_id)):
            names[recording_id] = recording.filename
    return names
