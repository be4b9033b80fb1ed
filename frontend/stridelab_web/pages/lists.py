"""The lists of recordings, jobs and subjects, and the page of one subject with the recordings of that person."""

from typing import Final, TypedDict

from starlette.requests import Request
from starlette.responses import Response

from stridelab_web.api_client import client_of
from stridelab_web.formatting import KINDS
from stridelab_web.formatting import job_kind_name as name_of
from stridelab_web.pages.render import render_page
from stridelab_web.pages.results.measures import N_CANDIDATES, newest_gait

OFFERED: Final = 50
"""Number of recordings without a subject that are offered at a time."""


class ListQuery(TypedDict):
    """Words, order and page of a list; None for what its address does not state."""

    search: str | None
    sort: str | None
    cursor: str | None


async def subjects_page(request: Request) -> Response:
    """``GET /subjects``."""
    listed = await client_of(request).subjects(**list_query(request))
    return render_page(
        request,
        "pages/subjects.html",
        section="Subjects",
        subjects=listed.items,
        query=request.query_params,
        next=next_page(request, listed.next),
    )


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
    """``GET /recordings?search=&sort=&session_id=``."""
    query = request.query_params
    client, session_id = client_of(request), query.get("session_id") or None
    listed = await client.recordings(session_id=session_id, **list_query(request))
    gait = None
    walks = [one.id for one in listed.items if not one.still] if session_id is not None else []
    for walk in walks[:N_CANDIDATES]:  # the newest may have been uploaded after the others were measured
        gait = gait or await newest_gait(client, walks, (await client.jobs(recording_id=walk)).items)
    return render_page(
        request,
        "pages/recordings.html",
        section="Recordings",
        recordings=listed.items,
        gait=gait,
        query=query,
        next=next_page(request, listed.next),
    )


async def jobs_page(request: Request) -> Response:
    """``GET /jobs?state=&kind=&search=``: all jobs, or those of one state, of one kind, or that contain words."""
    client, query = client_of(request), request.query_params
    state, kind, search = query.get("state", ""), query.get("kind", ""), query.get("search", "")
    listed = await client.jobs(
        state=state or None, kind=kind or None, search=search or None, cursor=query.get("cursor")
    )
    return render_page(
        request,
        "pages/jobs.html",
        section="Jobs",
        jobs=listed.items,
        next=next_page(request, listed.next),
        state_filter=state,
        kind_filter=kind,
        query=query,
        kinds=sorted({*KINDS, *(job.kind for job in listed.items), kind} - {""}, key=name_of),
    )


def list_query(request: Request) -> ListQuery:
    """The fields of a list's address, for the client."""
    query = request.query_params
    return {"search": query.get("search") or None, "sort": query.get("sort") or None, "cursor": query.get("cursor")}


def next_page(request: Request, cursor: str | None) -> str | None:
    """Address of the next page of a list with the same search, order and filters; None on the last page."""
    return None if cursor is None else str(request.url.include_query_params(cursor=cursor).query)
