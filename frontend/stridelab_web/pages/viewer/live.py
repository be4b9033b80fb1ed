"""The pages of live robots: those that are open, and one of them in 3D, to be watched and pushed."""

from starlette.requests import Request
from starlette.responses import Response

from stridelab.client import ProblemError
from stridelab_web.api_client import client_of, none_if_missing
from stridelab_web.pages.home import SAMPLE_SCENARIO
from stridelab_web.pages.render import render_page
from stridelab_web.pages.viewer.preparing import preparation_page
from stridelab_web.scene.documents import Document

LISTED = 100


async def live_robots_page(request: Request) -> Response:
    """``GET /live/robots?scenario=``: the live robots, and what can be started."""
    client = client_of(request)
    listed, scenarios = await client.live_robots(), (await client.scenarios(limit=LISTED)).items
    chosen = request.query_params.get("scenario", SAMPLE_SCENARIO)
    if all(scenario.id != chosen for scenario in scenarios):
        wanted = await none_if_missing(client.scenario(chosen))
        scenarios = [*scenarios, *([] if wanted is None else [wanted])]
    return render_page(
        request,
        "pages/live_robots.html",
        section="Live",
        sessions=listed.items,
        scenarios=sorted(scenarios, key=lambda scenario: (scenario.bundled, scenario.name)),
        robots=(await client.robots()).items,
        chosen=chosen,
    )


async def live_robot_page(request: Request) -> Response:
    """``GET /live/robots/{id}``."""
    client = client_of(request)
    try:
        session = await client.live_robot(request.path_params["id"])
    except ProblemError as refusal:
        if refusal.code != "session-not-found":
            raise
        return render_page(request, "pages/live_ended.html", 404, section="Live")
    if (waiting := await preparation_page(request, session.robot, session.title)) is not None:
        return waiting
    scene = Document("robot", session.robot)
    if session.scenario_id is not None:
        scene = Document("scenario", session.scenario_id)
    return render_page(request, "viewer/view_live.html", section="Live", session=session, scene=scene.address)
