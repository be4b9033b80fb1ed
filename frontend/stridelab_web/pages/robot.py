"""Robots: the list, and the page of one with its effectors, joints and learned densities."""

from typing import Final

from starlette.requests import Request
from starlette.responses import JSONResponse, Response

from stridelab.client import AsyncClient, ProblemError
from stridelab.schemas.jobs import Job
from stridelab.schemas.robots import Measure, RobotFacts
from stridelab.schemas.scenarios import SceneName
from stridelab_web.api_client import client_of, none_if_missing
from stridelab_web.assets import plotly_style_ids
from stridelab_web.pages.render import render_page
from stridelab_web.pages.results import reachability
from stridelab_web.pages.terms.robots import ROBOT_TERMS
from stridelab_web.pages.viewer.preparing import preparation_page
from stridelab_web.scene.documents import Document

NOT_LOADABLE: Final = frozenset({"robot-data-missing", "robot-data-unreadable", "robot-not-loaded"})
"""Error codes of robots that have a card but cannot be loaded."""

SCENES: Final[tuple[tuple[SceneName, str], ...]] = (
    ("flat-walk", "Level walk"),
    ("long-stride", "Long strides"),
    ("six-stairs", "Six stairs"),
    ("stairs-down", "Downstairs"),
    ("stairs-with-rail", "Stairs with a rail"),
    ("stand-up", "Standing up"),
)
"""Bundled scenes that are scaled to the robot, and their titles."""
HAND_SCENES: Final = frozenset({"stairs-with-rail", "stand-up"})


async def robots_page(request: Request) -> Response:
    """``GET /robots``; the page itself requests the facts that need a loaded robot."""
    listed = await client_of(request).robots()
    return render_page(request, "pages/robots/robots.html", section="Robots", robots=listed.items)


async def robot_page(request: Request) -> Response:
    """``GET /robots/{name}``, ``measure`` selects the densities."""
    client, name = client_of(request), request.path_params["name"]
    try:
        robot = await client.robot(name)
    except ProblemError as refusal:
        if refusal.code not in NOT_LOADABLE:
            raise
        robot_card = next(item for item in (await client.robots()).items if item.name == name)
        return render_page(
            request, "pages/robots/robot_missing.html", 503, section="Robots", robot=robot_card, reason=refusal.detail
        )
    own = await none_if_missing(client.robot_card(name)) if robot.own else None
    measure = _shown_measure(robot, request.query_params.get("measure"))
    cards = [card for card in robot.proxies if card.measure == measure]
    return render_page(
        request,
        "pages/robots/robot.html",
        section="Robots",
        robot=robot,
        own=own,
        robot_terms=ROBOT_TERMS,
        commissioning=await unfinished_commission(client, name) if own else None,
        measure=measure,
        learned=reachability.density_values(cards, f"/robots/{robot.name}/reach.json?measure={measure}")
        if cards
        else None,
        scenes=[one for one in SCENES if one[0] not in HAND_SCENES or (robot.walker and robot.walker.arm_m)],
        plotly_style_ids=plotly_style_ids() if cards else (),
    )


async def unfinished_commission(client: AsyncClient, name: str) -> Job | None:
    """The newest job that commissions a robot, unless it has succeeded: it waits, runs, or ended without a result."""
    listed = await client.jobs(kind="commission-robot")
    newest = next((job for job in listed.items if job.about == name), None)
    return None if newest is None or newest.state == "succeeded" else newest


async def robot_view_page(request: Request, name: str) -> Response:
    """``GET /view/?robot=&measure=&effector=``."""
    if (waiting := await preparation_page(request, name, name)) is not None:
        return waiting
    robot = await client_of(request).robot(name)
    reach = {
        measure: {card.effector: card.frame for card in robot.proxies if card.measure == measure}
        for measure in robot.measures
    }
    return render_page(
        request,
        "viewer/view_robot.html",
        robot=robot,
        scene=Document("robot", robot.name).address,
        measure=_shown_measure(robot, request.query_params.get("measure")),
        reach=reach,
    )


async def reach_json(request: Request) -> Response:
    """``GET /robots/{name}/reach.json?measure=&effector=``: the projected densities of one effector."""
    client, name = client_of(request), request.path_params["name"]
    facts = await client.robot(name)
    measure = _shown_measure(facts, request.query_params.get("measure"))
    try:
        learned = await client.robot_reachability(name, measure)
    except ProblemError as refusal:  # for a script, not for a reader
        return JSONResponse(refusal.problem.model_dump(mode="json"), status_code=refusal.status)
    return reachability.maps_response(learned, request)


def _shown_measure(robot: RobotFacts, requested: str | None) -> Measure:
    """The requested measure if it was learned, else that of plans, else the first learned one."""
    if requested in robot.measures:
        return next(measure for measure in robot.measures if measure == requested)
    if robot.default_measure in robot.measures or not robot.measures:
        return robot.default_measure
    return robot.measures[0]
