"""Robots: the list, and the page of one with its effectors, joints and learned densities."""

from typing import Final

from starlette.requests import Request
from starlette.responses import JSONResponse, Response

from stridelab.client import ProblemError
from stridelab.schemas.robots import Measure, RobotFacts
from stridelab_web.api_client import client_of
from stridelab_web.assets import plotly_style_ids
from stridelab_web.pages.render import page
from stridelab_web.pages.results import reachability
from stridelab_web.pages.viewer.preparing import preparing
from stridelab_web.scene.documents import Document

NOT_HERE: Final = frozenset({"robot-data-missing", "robot-data-unreadable", "robot-not-loaded"})
"""Error codes of robots that have a card but cannot be loaded."""


async def robots(request: Request) -> Response:
    """``GET /robots``; the page itself requests the facts that need a loaded robot."""
    listed = await client_of(request).robots()
    return page(request, "pages/robots.html", section="Robots", robots=listed.items)


async def robot(request: Request) -> Response:
    """``GET /robots/{name}``, ``measure`` selects the densities."""
    client, name = client_of(request), request.path_params["name"]
    try:
        robot = await client.robot(name)
    except ProblemError as refusal:
        if refusal.code not in NOT_HERE:
            raise
        robot_card = next(item for item in (await client.robots()).items if item.name == name)
        return page(request, "pages/robot_missing.html", 503, section="Robots", robot=robot_card, reason=refusal.detail)
    measure = _measure(robot, request.query_params.get("measure"))
    cards = [card for card in robot.proxies if card.measure == measure]
    return page(
        request,
        "pages/robot.html",
        section="Robots",
        robot=robot,
        measure=measure,
        learned=reachability.shown(cards, f"/robots/{robot.name}/reach.json?measure={measure}") if cards else None,
        plotly_style_ids=plotly_style_ids() if cards else (),
    )


async def scene(request: Request, name: str) -> Response:
    """``GET /view/?robot=&measure=&effector=``."""
    if (waiting := await preparing(request, name, name)) is not None:
        return waiting
    robot = await client_of(request).robot(name)
    reach = {
        measure: {card.effector: card.frame for card in robot.proxies if card.measure == measure}
        for measure in robot.measures
    }
    return page(
        request,
        "viewer/view_robot.html",
        robot=robot,
        scene=Document("robot", robot.name).address,
        measure=_measure(robot, request.query_params.get("measure")),
        reach=reach,
    )


async def reach(request: Request) -> Response:
    """``GET /robots/{name}/reach.json?measure=&effector=``: the projected densities of one effector."""
    client, name = client_of(request), request.path_params["name"]
    facts = await client.robot(name)
    measure = _measure(facts, request.query_params.get("measure"))
    try:
        learned = await client.robot_reachability(name, measure)
    except ProblemError as refusal:  # for a script, not for a reader
        return JSONResponse(refusal.problem.model_dump(mode="json"), status_code=refusal.status)
    return reachability.maps(learned, request)


def _measure(found: RobotFacts, asked: str | None) -> Measure:
    """The requested measure if it was learned, else that of plans, else the first learned one."""
    if asked in found.measures:
        return next(measure for measure in found.measures if measure == asked)
    if found.default_measure in found.measures or not found.measures:
        return found.default_measure
    return found.measures[0]
