"""The page of settings and tokens: what is in force, who one is here, and how a script calls. It shows no secret."""

from starlette.requests import Request
from starlette.responses import Response

from stridelab_web.config import WebConfig
from stridelab_web.pages.render import page
from stridelab_web.service import client_of


async def settings(request: Request) -> Response:
    """``GET /settings``."""
    config: WebConfig = request.app.state.config
    client = client_of(request)
    return page(
        request,
        "settings.html",
        section="Settings",
        health=await client.health(),
        solvers=await client.solvers(),
        settings=config.settings,
        viewer=config.viewer_url is not None,
        address=str(request.base_url).rstrip("/"),
    )
