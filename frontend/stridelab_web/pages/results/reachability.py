"""Shared by the pages of robots and of jobs that learn densities: cards, curves and maps."""

from collections.abc import Sequence
from typing import Any, Final

from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import JSONResponse, Response

from stridelab.client import AsyncClient
from stridelab.schemas.jobs import JobResult
from stridelab.schemas.reachability import RobotReachability
from stridelab.schemas.robots import ProxyCard
from stridelab_web.api_client import client_of
from stridelab_web.formatting import code_words
from stridelab_web.pages.results.reachability_plots import divergence_charts, drawing_of, style_of
from stridelab_web.pages.results.summary_facts import Fact

KIND: Final = "learn-reachability"
FILE: Final = "reachability.json"
IN_TABLE: Final = ("effectors.", "robot_sha256", "samples", "tried", "rejected_share", "learned_on")
CACHE_HEADERS: Final = {"Cache-Control": "private, max-age=600"}


def density_values(cards: Sequence[ProxyCard], address: str) -> dict[str, Any]:
    """Template values of densities (_reach.html); ``address`` is that of their maps."""
    return {
        "cards": cards,
        "charts": divergence_charts(cards),
        "legend": [
            *((*style_of(k), f"{code_words(card.effector)}: {card.components}") for k, card in enumerate(cards)),
            ("thesis", "ring", "the thesis"),
        ],
        "address": address,
    }


async def learned_of(client: AsyncClient, job_id: str, result: JobResult) -> dict[str, Any] | None:
    """Template values of the densities of a job; None for a result without their file."""
    if all(item.name != FILE for item in result.artifacts):
        return None
    learned = await _read_densities(client, job_id)
    return density_values([each.card for each in learned.effectors], f"/jobs/{job_id}/reach.json")


def facts_beside_table(facts: Sequence[Fact]) -> list[Fact]:
    """Facts of a job that its table of densities does not contain."""
    return [fact for fact in facts if not fact.key.startswith(IN_TABLE)]


async def reach_json(request: Request) -> Response:
    """``GET /jobs/{id}/reach.json?effector=``: the maps of one effector."""
    client, job_id = client_of(request), request.path_params["id"]
    if all(item.name != FILE for item in (await client.result(job_id)).artifacts):
        raise HTTPException(404, "This job has learned no densities.")
    return maps_response(await _read_densities(client, job_id), request)


def maps_response(learned: RobotReachability, request: Request) -> Response:
    """The maps of the requested effector, or of the first one."""
    wanted = request.query_params.get("effector")
    for each in learned.effectors:
        if wanted in (None, each.card.effector):
            return JSONResponse(drawing_of(each), headers=CACHE_HEADERS)
    raise HTTPException(404, "Nothing was learned for this effector.")


async def _read_densities(client: AsyncClient, job_id: str) -> RobotReachability:
    return RobotReachability.model_validate_json(await client.read_artifact(job_id, FILE))
