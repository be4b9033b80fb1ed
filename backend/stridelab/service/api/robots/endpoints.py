"""Robots: which there are, what is known of them, and what they look like."""

from typing import Any, Final

import anyio
from fastapi import APIRouter, Request
from starlette.responses import Response, StreamingResponse

from stridelab.schemas.base import Page
from stridelab.schemas.robots import RobotFacts, RobotSummary
from stridelab.service.api.files import send_blob
from stridelab.service.api.openapi import failures
from stridelab.service.api.parts import AppParts
from stridelab.service.api.robots.catalogue import known_name, summaries
from stridelab.service.api.strict import StrictRoute
from stridelab.service.storage.blobs import BlobInfo

router = APIRouter(prefix="/robots", tags=["robots"], route_class=StrictRoute)

GLTF: Final = "model/gltf-binary"
_FAILURES: Final = failures(
    s404="No robot of this name (`robot-not-found`).",
    s503="The robot's description is not installed (`robot-data-missing`) or cannot be loaded (`robot-not-loaded`).",
)
_MESHES: Final[dict[int | str, dict[str, Any]]] = {
    200: {"description": "The meshes.", "content": {GLTF: {"schema": {"type": "string", "format": "binary"}}}}
}


@router.get("", summary="List robots")
async def list_robots() -> Page[RobotSummary]:
    """All robots by name, with their effectors; one whose description is not installed here says so in `reason`."""
    return Page[RobotSummary](items=await anyio.to_thread.run_sync(summaries))


@router.get("/{name}", summary="One robot", responses=_FAILURES)
async def get_robot(parts: AppParts, name: str) -> RobotFacts:
    """Mass, effectors, reference posture, limits, and how well the reach of each effector is known.

    The first question loads the robot, which takes a few seconds.
    """
    return await parts.robots.facts(known_name(name))


@router.get(
    "/{name}/links",
    summary="Display meshes of a robot",
    responses={**_FAILURES, **_MESHES},
    response_class=StreamingResponse,
)
async def get_links(parts: AppParts, name: str, request: Request) -> Response:
    """The robot's visual meshes as binary glTF, one named node per moving link, each in its link's frame.

    They are made when first asked for, which takes a while, and kept. `ETag` and `If-None-Match` spare sending them
    again.
    """
    robot = known_name(name)
    info = await parts.robots.links(robot)
    headers = {"ETag": _etag(info)}
    if _already_there(request.headers.get("if-none-match", ""), headers["ETag"]):
        return Response(status_code=304, headers={**headers, "Cache-Control": "private, no-cache"})
    return await send_blob(parts, info.key, f"{robot}-links.glb", GLTF, headers)


def _etag(info: BlobInfo) -> str:
    """Changes whenever the file is written anew."""
    return f'"{info.key.split("/")[-2][:16]}-{info.bytes:x}-{round(info.modified_at.timestamp() * 1e3):x}"'


def _already_there(asked: str, etag: str) -> bool:
    return etag in {tag.strip().removeprefix("W/") for tag in asked.split(",")} or asked.strip() == "*"
