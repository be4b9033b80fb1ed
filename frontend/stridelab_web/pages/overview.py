"""Home and the two lists."""

from starlette.requests import Request
from starlette.responses import Response

from stridelab_web.pages.render import page
from stridelab_web.service import client_of

LATEST = 6


async def home(request: Request) -> Response:
    """``GET /``."""
    client = client_of(request)
    recordings, jobs = await client.recordings(limit=LATEST), await client.jobs(limit=LATEST)
    return page(request, "home.html", section="Home", recordings=recordings.items, jobs=jobs.items)


async def recordings(request: Request) -> Response:
    """``GET /recordings``."""
    found = await client_of(request).recordings(cursor=request.query_params.get("cursor"))
    return page(request, "recordings.html", section="Recordings", recordings=found.items, next=found.next)


async def jobs(request: Request) -> Response:
    """``GET /jobs``, optionally of one state."""
    query = request.query_params
    state = query.get("state", "")
    found = await client_of(request).jobs(state=state or None, cursor=query.get("cursor"))
    return page(request, "jobs.html", section="Jobs", jobs=found.items, next=found.next, state_filter=state)
