"""Endpoints of robots: list, facts, preparation, display meshes, and reachability of the centre of mass."""

import gzip
import hashlib
from typing import Any, Final

import anyio
from fastapi import APIRouter, Request
from starlette.responses import Response, StreamingResponse

from stridelab.errors import NotFound, StridelabError
from stridelab.robots.card import robot_card, robot_names
from stridelab.robots.data_files import data_files
from stridelab.schemas.base import Page
from stridelab.schemas.reachability import RobotReachability
from stridelab.schemas.robots import Measure, RobotFacts, RobotPreparation, RobotSummary
from stridelab.service.api.dependencies import AppParts
from stridelab.service.api.downloads import send_blob
from stridelab.service.api.openapi import failure_responses
from stridelab.service.api.robots.cache import RobotCache
from stridelab.service.api.strict_json import StrictRoute
from stridelab.service.storage.blobs import BlobInfo

router = APIRouter(prefix="/robots", tags=["robots"], route_class=StrictRoute)

GLTF: Final = "model/gltf-binary"
JSON: Final = "application/json"
_FAILURES: Final = failure_responses(
    s404="No robot of this name (`robot-not-found`).",
    s503="The robot's description is not installed (`robot-data-missing`) or cannot be loaded (`robot-not-loaded`).",
)
_UNKNOWN: Final = failure_responses(s404="No robot of this name (`robot-not-found`).")
_MESHES: Final[dict[int | str, dict[str, Any]]] = {
    200: {"description": "The meshes.", "content": {GLTF: {"schema": {"type": "string", "format": "binary"}}}}
}


_REACH_FAILURES: Final = failure_responses(
    s404="No robot of this name (`robot-not-found`), or no densities for the measure (`reachability-not-learned`).",
    s503="The robot's description is not installed (`robot-data-missing`) or cannot be loaded (`robot-not-loaded`), "
    "or the densities were learned on another description of the robot (`reachability-of-another-robot`).",
)


@router.get("", summary="List robots")
async def list_robots(parts: AppParts) -> Page[RobotSummary]:
    """List all robots by name, with their effectors; for one that cannot be loaded, `reason` gives the cause.

    Each robot is loaded once for this, which takes a few seconds at the first request.
    """
    robots = await anyio.to_thread.run_sync(robot_summaries)
    return Page[RobotSummary](items=[await check_loading(summary, parts.robots) for summary in robots])


@router.get("/{name}", summary="One robot", responses=_FAILURES)
async def get_robot(parts: AppParts, name: str) -> RobotFacts:
    """Mass, effectors, reference posture, limits, and the quality of the reachability density of each effector.

    If the robot is not prepared yet, the response waits a few seconds until it is loaded.
    """
    return await parts.robots.facts(require_robot(name))


@router.get("/{name}/preparation", summary="How far the files of a robot are", responses=_UNKNOWN)
async def get_preparation(parts: AppParts, name: str) -> RobotPreparation:
    """State of the facts, display meshes and densities of a robot: ready, or the progress from 0 to 1.

    A service prepares its robots at its first start; this request starts the preparation of a robot that is not ready.
    It responds within a second.
    """
    return await parts.robots.preparation_state(require_robot(name))


@router.get(
    "/{name}/links",
    summary="Display meshes of a robot",
    responses={**_FAILURES, **_MESHES},
    response_class=StreamingResponse,
)
async def get_links(parts: AppParts, name: str, request: Request) -> Response:
    """Visual meshes of the robot as binary glTF, with one named node per moving link, in the frame of the link.

    A service creates them at its first start or at the first request, and stores them;
    `GET /robots/{name}/preparation` returns the progress. `ETag` and `If-None-Match` avoid repeated downloads.
    """
    robot = require_robot(name)
    info = await parts.robots.link_meshes(robot)
    headers = {"ETag": _file_etag(info)}
    if _is_not_modified(request, headers["ETag"]):
        return Response(status_code=304, headers={**headers, "Cache-Control": "private, no-cache"})
    return await send_blob(parts, info.key, f"{robot}-links.glb", GLTF, headers)


@router.get(
    "/{name}/reachability",
    summary="Where the centre of mass of a robot can be",
    responses=_REACH_FAILURES,
    response_model=RobotReachability,
)
async def get_reachability(parts: AppParts, name: str, request: Request, measure: Measure | None = None) -> Response:
    """Per effector: sampled positions of the CoM, level sets of their density as triangle meshes, and projections.

    Without `measure`, the densities that plans use. Computed together with the display meshes, and stored; sent
    compressed if the client accepts gzip.
    """
    compressed = await parts.robots.reachability_json(require_robot(name), measure)
    headers = {
        "ETag": f'"{hashlib.sha256(compressed).hexdigest()[:32]}"',
        "Cache-Control": "private, no-cache",
        "Vary": "Accept-Encoding",
    }
    if _is_not_modified(request, headers["ETag"]):
        return Response(status_code=304, headers=headers)
    if "gzip" in request.headers.get("accept-encoding", ""):
        return Response(compressed, media_type=JSON, headers={**headers, "Content-Encoding": "gzip"})
    return Response(gzip.decompress(compressed), media_type=JSON, headers=headers)


def _file_etag(info: BlobInfo) -> str:
    """ETag of a stored file: hash of its sources, size, and time of modification."""
    return f'"{info.key.split("/")[-2][:16]}-{info.bytes:x}-{round(info.modified_at.timestamp() * 1e3):x}"'


def _is_not_modified(request: Request, etag: str) -> bool:
    tags = request.headers.get("if-none-match", "")
    return etag in {tag.strip().removeprefix("W/") for tag in tags.split(",")} or tags.strip() == "*"


def require_robot(name: str) -> str:
    """Return ``name`` if a robot of this name exists; raises ``NotFound`` (``robot-not-found``) otherwise.

    The returned string is the registered one, so that user input is never used as a path.
    """
    names = robot_names()
    if name not in names:
        raise NotFound("robot-not-found", f"There is no robot of this name; available: {', '.join(names) or 'none'}.")
    return names[names.index(name)]


def robot_summaries() -> list[RobotSummary]:
    """Summaries of all robots, by name; with the reason for an invalid card or missing files."""
    return [_robot_summary(name) for name in robot_names()]


async def check_loading(summary: RobotSummary, robots: RobotCache) -> RobotSummary:
    """Load the robot of ``summary``; return the summary with the result in ``available`` and ``reason``."""
    reason = await robots.load_problem(summary.name) if summary.available else summary.reason
    return summary.model_copy(update={"available": reason is None, "reason": reason})


def _robot_summary(name: str) -> RobotSummary:
    try:
        card = robot_card(name)
    except StridelabError as error:
        return RobotSummary(name=name, title=name, licence="", available=False, reason=error.message, effectors=[])
    reason = None
    try:
        data_files(card)
    except StridelabError as error:
        reason = error.message
    return RobotSummary(
        name=name,
        title=card.title,
        licence=card.licence,
        available=reason is None,
        reason=reason,
        effectors=list(card.effectors),
    )
