"""``/live``: a robot that carries out its motion in physics while people watch and push it."""

from typing import Annotated, Any, Final

from fastapi import APIRouter, Body, Response
from pydantic import ValidationError
from starlette.websockets import WebSocket

from stridelab.errors import Fault, Forbidden, InvalidInput, NotFound, StridelabError
from stridelab.robots.card import robot_names
from stridelab.schemas.live.messages import LIVE_COMMAND, LiveInput, LiveRefused, LiveSession, LiveSessions
from stridelab.service.api.dependencies import AppParts, CallerOf, Parts
from stridelab.service.api.live.room import LiveMotion, LiveRoom
from stridelab.service.api.live.viewers import Viewer
from stridelab.service.api.openapi import failure_responses
from stridelab.service.api.problems import faults_of
from stridelab.service.api.scenarios.repository import scenario_of, scenario_row
from stridelab.service.api.stream.endpoints import receive_message, send_until_end, serve_stream
from stridelab.service.api.stream.limits import SampleRateLimiter
from stridelab.service.api.stream.messages import TEXT, Parcel
from stridelab.service.api.strict_json import StrictRoute, parse_json
from stridelab.service.auth.callers import Caller, require_owner, require_scope
from stridelab.service.stored_robots import find_robot

router = APIRouter(prefix="/live", tags=["live"], route_class=StrictRoute)

COMMAND_BYTES: Final = 2000
COMMANDS_HZ: Final = 50.0
_BODIES: Final[Any] = {
    "stairs": {"summary": "The bundled stairs", "value": {"scenario_id": "six-stairs"}},
    "walk": {"summary": "A level walk", "value": {"robot": "g1"}},
}
_ABOUT: Final = {"id", "created_at", "updated_at", "bundled", "owner"}


@router.post(
    "",
    status_code=201,
    summary="Start a live robot",
    responses=failure_responses(
        s404="No scenario or robot of this name (`scenario-not-found`, `robot-not-found`).",
        s422="Neither or both of `scenario_id` and `robot` are given (`invalid-request`).",
        s429="Too many robots are live (`too-many-live`); `Retry-After` gives the time to wait.",
    ),
)
async def start_live(
    parts: AppParts, caller: CallerOf, body: Annotated[LiveInput, Body(openapi_examples=_BODIES)], response: Response
) -> LiveSession:
    """Plan a motion and carry it out in physics, at real time, in a process of its own.

    The session is watched at `WS /live/{session_id}`, and on its page. It ends a minute after its last viewer has left
    (`STRIDELAB_LIVE_IDLE_S`).
    """
    session = parts.rooms.open_room(await _motion_of(parts, body), caller.name).describe()
    response.headers["Location"] = f"/api/v1/live/{session.session_id}"
    return session


@router.get("", summary="Live robots")
async def list_live(parts: AppParts) -> LiveSessions:
    """The live robots of this web server process, the newest first."""
    return LiveSessions(items=parts.rooms.describe_all())


@router.get(
    "/{session_id}",
    summary="A live robot",
    responses=failure_responses(s404="No live robot with this id (`session-not-found`)."),
)
async def get_live(parts: AppParts, session_id: str) -> LiveSession:
    """One live robot."""
    return parts.rooms.require_room(session_id).describe()


@router.delete(
    "/{session_id}",
    status_code=204,
    summary="End a live robot",
    responses=failure_responses(s404="No live robot with this id (`session-not-found`)."),
)
async def end_live(parts: AppParts, caller: CallerOf, session_id: str) -> None:
    """End a session and the connections of its viewers."""
    require_owner(caller, parts.rooms.require_room(session_id).owner, "live robot")
    await parts.rooms.close_room(session_id)


@router.websocket("/{session_id}")
async def watch_live(socket: WebSocket, parts: AppParts, caller: CallerOf, session_id: str) -> None:
    """Show a live robot and take commands for it, until it ends or the client closes."""

    async def show() -> None:
        room = parts.rooms.require_room(session_id)
        with room.watch(may_push=caller.has_scope("submit")) as viewer:
            receive = _receive_commands(socket, room, viewer, caller)
            idle_s = parts.settings.stream_idle_s
            await send_until_end(socket, viewer.next_message, receive, idle_s, reason="session-ended")

    await serve_stream(socket, parts, show)


async def _motion_of(parts: Parts, body: LiveInput) -> LiveMotion:
    async with parts.engine.connect() as connection:
        if body.scenario_id is not None:
            stored = scenario_of(await scenario_row(connection, body.scenario_id))
            document = stored.model_dump(mode="json", exclude=_ABOUT)
            return LiveMotion(stored.name, stored.robot, stored.id, document, body.velocity)
        robot = str(body.robot)
        if robot not in robot_names() and await find_robot(connection, robot) is None:
            raise NotFound("robot-not-found", "There is no robot of this name.")
    return LiveMotion(f"{robot.upper()}: level walk", robot, velocity=body.velocity)


async def _receive_commands(socket: WebSocket, room: LiveRoom, viewer: Viewer, caller: Caller) -> None:
    """Pass commands on until the client closes; those that cannot be carried out are refused with a message.

    Raises ``TooLarge`` (``message-too-large``), ``Busy`` (``stream-too-fast``), which close the websocket.
    """
    rate = SampleRateLimiter(COMMANDS_HZ)
    while True:
        parcel = await receive_message(socket, COMMAND_BYTES, None)
        rate.count_samples(1)
        try:
            require_scope(caller, "submit")
            room.command(viewer, _parse_command(parcel))
        except (InvalidInput, Forbidden) as refusal:
            viewer.send_message(_refusal_text(refusal))


def _parse_command(parcel: Parcel) -> dict[str, Any]:
    """The command of a message. Raises ``InvalidInput`` (``wrong-format``, ``not-json``, ``invalid-command``)."""
    if parcel.kind != TEXT:
        raise InvalidInput("wrong-format", "A command is a text message.")
    parse_json(parcel.content)
    try:
        command = LIVE_COMMAND.validate_json(parcel.content, strict=True)
    except ValidationError as error:
        faults = faults_of(error.errors(include_url=False, include_input=False, include_context=False)[:20])
        raise InvalidInput(
            "invalid-command", "This is no valid command.", [Fault(item.where, item.message) for item in faults]
        ) from error
    return command.model_dump(mode="json", exclude_unset=True)


def _refusal_text(refusal: StridelabError) -> str:
    places = "; ".join(f"{fault.where}: {fault.message}" for fault in refusal.faults)
    message = f"{refusal.message} {places}".strip()
    return LiveRefused(code=refusal.code, message=message).model_dump_json()
