"""Robots: the list, and the page of one: where it may touch, what its joints can do, how its reach was learned."""

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
"""Why a robot that has a card may have no page."""


async def robots(request: Request) -> Response:
    """``GET /robots``; what is known only of a robot that is loaded, the page asks for by itself."""
    found = await client_of(request).robots()
    return page(request, "pages/robots.html", section="Robots", robots=found.items)


async def robot(request: Request) -> Response:
    """``GET /robots/{name}``, with ``measure`` the one whose densities are shown."""
    client, name = client_of(request), request.path_params["name"]
    try:
        found = await client.robot(name)
    except ProblemError as refusal:
        if refusal.code not in NOT_HERE:
            raise
        known = next(item for item in (await client.robots()).items if item.name == name)
        return page(request, "pages/robot_missing.html", 503, section="Robots", robot=known, reason=refusal.detail)
    measure = _measure(found, request.query_params.get("measure"))
    cards = [card for card in found.proxies if card.measure == measure]
    return page(
        request,
        "pages/robot.html",
        section="Robots",
        robot=found,
        measure=measure,
        learned=reachability.shown(cards, f"/robots/{found.name}/reach.json?measure={measure}") if cards else None,
        plotly_style_ids=plotly_style_ids() if cards else (),
    )


async def scene(request: Request, name: str) -> Response:
    """``GET /view/?robot=&measure=&effector=``."""
    if (waiting := await preparing(request, name, name)) is not None:
        return waiting
    found = await client_of(request).robot(name)
    reach = {
        measure: {card.effector: card.frame for card in found.proxies if card.measure == measure}
        for measure in found.measures
    }
    return page(
        request,
        "viewer/view_robot.html",
        robot=found,
        scene=Document("robot", found.name).address,
        measure=_measure(found, request.query_params.get("measure")),
        reach=reach,
    )


async def reach(request: Request) -> Response:
    """``GET /robots/{name}/reach.json?measure=&effector=``: the projected densities of one effector."""
    client, name = client_of(request), request.path_params["name"]
    facts = await client.robot(name)
    measure = _measure(facts, request.query_params.get("measure"))
    try:
        found = await client.robot_reachability(name, measure)
    except ProblemError as refusal:  # for a script, not for a reader
        return JSONResponse(refusal.problem.model_dump(mode="json"), status_code=refusal.status)
    return reachability.maps(found, request)


def _measure(found: RobotFacts, asked: str | None) -> Measure:
    """What is asked for where it was learned; else what plans use, or what there is."""
    if asked in found.measures:
        return next(measure for measure in found.measures if measure == asked)
    if found.default_measure in found.measures or not found.measures:
        return found.default_measure
    return found.measures[0]
