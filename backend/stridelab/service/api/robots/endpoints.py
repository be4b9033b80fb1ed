"""Endpoints of robots: list, facts, preparation, display meshes, and reachability of the centre of mass."""

import gzip
import hashlib
import re
import shutil
from collections.abc import Mapping
from typing import Annotated, Any, Final

import anyio
from fastapi import APIRouter, Body, Request
from starlette.responses import Response, StreamingResponse

from stridelab.errors import Fault, InvalidInput, StridelabError, Unavailable
from stridelab.robots.card import robot_card, robot_names
from stridelab.robots.data_files import data_files
from stridelab.schemas.base import Page
from stridelab.schemas.reachability import RobotReachability
from stridelab.schemas.robots import (
    NAME_PATTERN,
    Measure,
    OwnRobot,
    RobotFacts,
    RobotPackage,
    RobotPreparation,
    RobotSummary,
)
from stridelab.service.api.dependencies import AppParts, CallerOf, Parts
from stridelab.service.api.downloads import send_blob
from stridelab.service.api.openapi import failure_responses, file_response, form_body
from stridelab.service.api.recordings.multipart import Limits, receive_forms
from stridelab.service.api.recordings.service import spool_folder
from stridelab.service.api.robots.cache import RobotCache, require_robot
from stridelab.service.api.robots.own import (
    add_installed_robot,
    add_robot,
    delete_robot,
    list_installed,
    own_reachability,
    own_robot,
    own_summaries,
    replace_card,
    required_robot,
)
from stridelab.service.api.strict_json import StrictRoute
from stridelab.service.storage.blobs import BlobInfo
from stridelab.service.stored_robots import find_robot

router = APIRouter(prefix="/robots", tags=["robots"], route_class=StrictRoute)

GLTF: Final = "model/gltf-binary"
JSON: Final = "application/json"
_FAILURES: Final = failure_responses(
    s404="No robot of this name (`robot-not-found`).",
    s503="The robot's description is not installed (`robot-data-missing`) or cannot be loaded (`robot-not-loaded`).",
)
_UNKNOWN: Final = failure_responses(s404="No robot of this name (`robot-not-found`).")
_MESHES: Final = file_response("The meshes.", GLTF)
_OWN: Final = failure_responses(
    s403="The robot belongs to another user (`not-owner`).",
    s404="No robot of this name (`robot-not-found`).",
    s409="A bundled robot (`bundled-read-only`), or one that is in use (`robot-in-use`) or was changed concurrently "
    "(`changed-meanwhile`).",
)
_FORM: Final = form_body(
    {
        "file": {
            "type": "string",
            "format": "binary",
            "description": "a .zip of one URDF (.urdf) or MJCF (.xml) and its meshes, or such a file without meshes",
        },
        "package": {
            "type": "string",
            "description": "in place of a file: an installed package of `GET /robots/packages`",
        },
        "name": {"type": "string", "pattern": NAME_PATTERN},
        "description": {
            "type": "string",
            "description": "which description of a zip or package with several is read: its path in it, or its end",
        },
    },
    "name",
)
_CARD: Final[Any] = {
    "excerpt": {
        "summary": "Fields of a card, as in the card file",
        "value": {"title": "My robot", "licence": "ours", "limits": {"torque_nm": {"left_knee": 120.0}}},
    }
}
_REACH_FAILURES: Final = failure_responses(
    s404="No robot of this name (`robot-not-found`), or no densities for the measure (`reachability-not-learned`).",
    s503="The robot's description is not installed (`robot-data-missing`) or cannot be loaded (`robot-not-loaded`), "
    "or the densities were learned on another description of the robot (`reachability-of-another-robot`).",
)


@router.get("", summary="List robots")
async def list_robots(parts: AppParts) -> Page[RobotSummary]:
    """List all robots by name, with their effectors; for one that cannot be loaded, `reason` gives the cause.

    Bundled robots come first, then those that users uploaded, with their `state` and `owner`. Each bundled robot is
    loaded once for this, which takes a few seconds at the first request.
    """
    robots = await anyio.to_thread.run_sync(robot_summaries)
    bundled = [await check_loading(summary, parts.robots) for summary in robots]
    return Page[RobotSummary](items=[*bundled, *await own_summaries(parts)])


@router.post(
    "",
    status_code=201,
    summary="Upload a robot",
    openapi_extra=_FORM,
    responses=failure_responses(
        s409="There is a robot of this name (`robot-name-taken`).",
        s413="The file exceeds the size limit (`upload-too-large`) or your storage limit (`storage-limit`).",
        s422="The archive, its description or a mesh cannot be read, the zip holds several descriptions and none is "
        "chosen (`robot-several-descriptions`, with their paths), no such package is installed "
        "(`robot-package-unknown`, naming the nearest), the description is invalid "
        "(`robot-description-invalid`), or the robot does not walk on two soles (`robot-not-humanoid`).",
        s507="No disk space is left (`disk-full`).",
    ),
)
async def upload_robot(parts: AppParts, caller: CallerOf, request: Request, response: Response) -> OwnRobot:
    """Upload a humanoid as a zip of a URDF and its meshes, or as a URDF without meshes, and get a proposed card.

    With `package` in place of `file`, the description is that of a package which is installed on the server.

    Soles, hands, joint groups, a rest posture, limits, rotor inertias and the pairs for the self-collision check are
    estimated from the description. `assumed` lists the fields that it does not state. Correct the card with
    `PUT /robots/{name}/card`, then submit `commission-robot`.
    """
    settings = parts.settings
    limits = Limits(settings.max_upload_mb * 1_000_000, settings.min_free_disk_mb * 1_000_000, required=False)
    folder = spool_folder(parts)
    try:
        form = await receive_forms(request, folder, limits)
        name = _name_of_form(form.fields)
        if "package" in form.fields and form.files:
            raise InvalidInput("invalid-request", "Send a file or the name of a package.", [Fault("package", "given")])
        if "package" in form.fields:
            stored = await add_installed_robot(parts, caller, form.fields, name, folder)
        elif form.files:
            stored = await add_robot(parts, caller, form.files[0], name, form.fields.get("description", ""))
        else:
            raise InvalidInput("file-missing", "The form has no field 'file'.", [Fault("file", "missing")])
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    response.headers["Location"] = f"/api/v1/robots/{stored.name}"
    return stored


@router.get("/packages", summary="List robots of installed packages")
async def list_packages(parts: AppParts) -> Page[RobotPackage]:
    """List the packages that are installed on the server and hold descriptions of robots with twelve moving joints.

    Python packages, and ROS packages in the folders `share` of the Python prefix and of `AMENT_PREFIX_PATH`. Send one
    of them with `POST /robots`; whether it is a humanoid on two soles is decided when it is read.
    """
    return Page[RobotPackage](items=await list_installed(parts))


@router.get("/{name}/card", summary="Card of one's own robot", responses=_OWN)
async def get_card(parts: AppParts, name: str) -> OwnRobot:
    """The card of a robot that a user uploaded, what of it was assumed, and the result of its commissioning."""
    async with parts.engine.connect() as connection:
        return own_robot(await required_robot(connection, name))


@router.put(
    "/{name}/card",
    summary="Correct the card of one's own robot",
    responses={
        **_OWN,
        **failure_responses(s422="A field is invalid (`robot-card-invalid`); `errors` names each of them."),
    },
)
async def put_card(
    parts: AppParts, caller: CallerOf, name: str, body: Annotated[dict[str, Any], Body(openapi_examples=_CARD)]
) -> OwnRobot:
    """Replace the card of one's own robot; it is checked with the robot's description before it is stored.

    If it changes, the densities that were learned are dropped and the state is `proposed`: commission the robot again.
    """
    folder = spool_folder(parts)
    try:
        return await replace_card(parts, caller, name, body, folder)
    finally:
        shutil.rmtree(folder, ignore_errors=True)


@router.delete("/{name}", status_code=204, summary="Delete one's own robot", responses=_OWN)
async def remove_robot(parts: AppParts, caller: CallerOf, name: str) -> None:
    """Delete one's own robot with its files. Finished results remain.

    Refused with `robot-in-use` while scenarios or unfinished jobs need it; `errors` names them.
    """
    await delete_robot(parts, caller, name)


@router.get("/{name}", summary="One robot", responses=_FAILURES)
async def get_robot(parts: AppParts, name: str) -> RobotFacts:
    """Mass, effectors, reference posture, limits, and the quality of the reachability density of each effector.

    If the robot is not prepared yet, the response waits a few seconds until it is loaded.
    """
    return await parts.robots.any_facts(name)


@router.get("/{name}/preparation", summary="How far the files of a robot are", responses=_UNKNOWN)
async def get_preparation(parts: AppParts, name: str) -> RobotPreparation:
    """State of the facts, display meshes and densities of a robot: ready, or the progress from 0 to 1.

    A service prepares its robots at its first start; this request starts the preparation of a robot that is not ready.
    It responds within a second.
    """
    if await _own_row(parts, name):
        return RobotPreparation(state="ready", fraction=1.0, message="ready")
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
    own = await _own_row(parts, name)
    robot = own["name"] if own else require_robot(name)
    info = await (parts.blobs.info(own["links_key"]) if own else parts.robots.link_meshes(robot))
    if info is None:
        raise Unavailable("storage-unavailable", "The file store has lost the meshes of this robot.")
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
    own = await _own_row(parts, name)
    if own:
        compressed = await own_reachability(parts, own, measure)
    else:
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


async def _own_row(parts: Parts, name: str) -> Mapping[str, Any] | None:
    """Row of the user's robot ``name``; None for a bundled or an unknown one."""
    if name in robot_names():
        return None
    async with parts.engine.connect() as connection:
        return await find_robot(connection, name)


def _name_of_form(fields: Mapping[str, str]) -> str:
    """The field ``name``. Raises ``InvalidInput`` (``invalid-request``)."""
    unknown = sorted(fields.keys() - {"name", "description", "package"})
    if unknown:
        message = "The form has the fields file, package, name and description only."
        raise InvalidInput("invalid-request", message, [Fault(field[:60], "unknown") for field in unknown])
    name = fields.get("name", "")
    if not re.fullmatch(NAME_PATTERN, name):
        message = "A robot's name has 2 to 40 small letters, digits and hyphens, and begins with a letter."
        raise InvalidInput("invalid-request", message, [Fault("name", "missing" if not name else "invalid")])
    return name


def _file_etag(info: BlobInfo) -> str:
    """ETag of a stored file: hash of its sources, size, and time of modification."""
    return f'"{info.key.split("/")[-2][:16]}-{info.bytes:x}-{round(info.modified_at.timestamp() * 1e3):x}"'


def _is_not_modified(request: Request, etag: str) -> bool:
    tags = request.headers.get("if-none-match", "")
    return etag in {tag.strip().removeprefix("W/") for tag in tags.split(",")} or tags.strip() == "*"


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
