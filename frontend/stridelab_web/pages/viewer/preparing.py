"""What a viewer's page shows while the files of its robot are still being made: how far they are."""

from starlette.requests import Request
from starlette.responses import Response

from stridelab.client import ProblemError
from stridelab_web.api_client import client_of
from stridelab_web.pages.render import page


async def preparing(request: Request, robot: str, title: str) -> Response | None:
    """The page that tells how far the files of ``robot`` are, and loads ``title``'s own page when they are there.

    None where there is nothing to wait for: the files are ready, they cannot be made, or there is no such robot. The
    page itself then shows the scene or says why it cannot.
    """
    try:
        found = await client_of(request).robot_preparation(robot)
    except ProblemError:
        return None
    if found.state != "preparing":
        return None
    percent = int(100 * found.fraction)
    return page(request, "viewer/view_preparing.html", title=title, robot=robot, percent=percent, message=found.message)
