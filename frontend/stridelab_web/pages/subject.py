"""Subjects: the table of all, and the page of one with the recordings of that person."""

from collections import Counter
from typing import Final

from starlette.requests import Request
from starlette.responses import Response

from stridelab.client import AsyncClient
from stridelab.schemas.recordings import Recording
from stridelab_web.pages.render import page
from stridelab_web.service import client_of

LENGTH: Final = 200
PAGES_AT_MOST: Final = 10
"""Whose a recording is stands in the recording: so many of them are asked for, 200 at a time."""


async def subjects(request: Request) -> Response:
    """``GET /subjects``."""
    client = client_of(request)
    found = await client.subjects(cursor=request.query_params.get("cursor"))
    recordings = await _newest_recordings(client)
    return page(
        request,
        "subjects.html",
        section="Subjects",
        subjects=found.items,
        next=found.next,
        counts=Counter(item.subject_id for item in recordings),
    )


async def subject(request: Request) -> Response:
    """``GET /subjects/{id}``."""
    client = client_of(request)
    found = await client.subject(request.path_params["id"])
    recordings = await _newest_recordings(client)
    return page(
        request,
        "subject.html",
        section="Subjects",
        subject=found,
        recordings=[item for item in recordings if item.subject_id == found.subject_id],
        others=[item for item in recordings if item.subject_id is None and not item.bundled],
    )


async def _newest_recordings(client: AsyncClient) -> list[Recording]:
    found: list[Recording] = []
    cursor = None
    for _ in range(PAGES_AT_MOST):
        listed = await client.recordings(limit=LENGTH, cursor=cursor)
        found += listed.items
        cursor = listed.next
        if cursor is None:
            break
    return found
