"""Home and the two lists."""

from starlette.requests import Request
from starlette.responses import Response

from stridelab_web.pages.render import backend_of, page

LATEST = 6


async def home(request: Request) -> Response:
    """``GET /``."""
    backend = backend_of(request)
    recordings, jobs = await backend.recordings(limit=LATEST), await backend.jobs(limit=LATEST)
    return page(request, "home.html", section="Home", recordings=recordings.items, jobs=jobs.items)


async def recordings(request: Request) -> Response:
    """``GET /recordings``."""
    found = await backend_of(request).recordings(cursor=request.query_params.get("cursor", ""))
    return page(request, "recordings.html", section="Recordings", recordings=found.items, next=found.next)


async def jobs(request: Request) -> Response:
    """``GET /jobs``, optionally of one state."""
    state = request.query_params.get("state", "")
    found = await backend_of(request).jobs(state=state, cursor=request.query_params.get("cursor", ""))
    return page(request, "jobs.html", section="Jobs", jobs=found.items, next=found.next, state_filter=state)
