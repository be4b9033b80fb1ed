"""The page of one robot: what it weighs, where it may touch, what its joints can do, how its reach was learned."""

from starlette.requests import Request
from starlette.responses import Response

from stridelab_web.pages.render import page
from stridelab_web.service import client_of


async def robot(request: Request) -> Response:
    """``GET /robots/{name}``."""
    found = await client_of(request).robot(request.path_params["name"])
    return page(request, "robot.html", section="Scenarios", robot=found)
