"""Subjects: the table of all, and the page of one with the recordings of that person."""

from typing import Final

from starlette.requests import Request
from starlette.responses import Response

from stridelab_web.api_client import client_of
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
