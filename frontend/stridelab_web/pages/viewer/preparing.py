"""The viewer's page while the files of a robot are being prepared: their progress."""

from starlette.requests import Request
from starlette.responses import Response

from stridelab.client import ProblemError
from stridelab_web.api_client import client_of
from stridelab_web.pages.render import render_page


async def preparation_page(request: Request, robot: str, title: str) -> Response | None:
    """The page with the progress of the files of ``robot``, which reloads itself when they are ready.

    None if the files are ready or cannot be prepared, or the robot does not exist; the page of the scene then reports
    errors.
    """
    try:
        preparation = await client_of(request).robot_preparation(robot)
    except ProblemError:
        return None
    if preparation.state != "preparing":
        return None
    percent = int(100 * preparation.fraction)
    return render_page(
        request, "viewer/view_preparing.html", title=title, robot=robot, percent=percent, message=preparation.message
    )
