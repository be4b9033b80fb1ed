"""``WS /stream/markers``: labelled markers and plate forces in, CoM and margin of stability out, frame by frame.

``WS /stream/markers/{stream_id}`` shows an open stream to others, and ``GET /stream/markers`` lists the open ones.
"""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Final

from fastapi import APIRouter
from starlette.websockets import WebSocket

from stridelab.errors import InvalidInput
from stridelab.schemas.streams import LiveStreams, MarkerStreamConfiguration, MarkerStreamReady, MarkerStreamTask
from stridelab.service.api.dependencies import AppParts, CallerOf, Parts
from stridelab.service.api.recordings.service import static_pose
from stridelab.service.api.stream.endpoints import (
    MEMORY_MB,
    ask_estimator,
    await_first,
    parse_configuration,
    receive_message,
    running_beside,
    send_until_end,
    serve_stream,
)
from stridelab.service.api.stream.limits import SampleRateLimiter
from stridelab.service.api.stream.messages import TEXT, Parcel
from stridelab.service.api.stream.watching import LiveChannel
from stridelab.service.auth.callers import Caller
from stridelab.service.settings import Settings
from stridelab.service.stored_marker_sets import source_marker_sets

router = APIRouter(prefix="/stream/markers", tags=["streams"])

ESTIMATOR: Final = "stridelab.service.api.stream.marker_session:MarkerStreamAnswerer"
HEADER_BYTES: Final = 200_000
MAX_FRAMES_HZ: Final = 250.0
"""Maximum rate of frames: placing the segments takes about 4 ms per frame."""
MAX_WAITING: Final = 100
"""Frames of a stream that may wait for the estimator; further ones wait at the client."""


@router.get("", summary="Open streams of markers")
async def list_marker_streams(parts: AppParts) -> LiveStreams:
    """The open streams of markers of this web server process, the newest first; `/live` shows one.

    A stream is sent to `WS /stream/markers` and watched at `WS /stream/markers/{stream_id}`.
    """
    return LiveStreams(items=parts.live.describe_all())


@router.websocket("")
async def stream_markers(socket: WebSocket, parts: AppParts, caller: CallerOf) -> None:
    """Estimate balance from labelled markers and plate forces frame by frame, until the client closes."""

    async def exchange() -> None:
        with parts.streams.reserve_place():
            await _exchange_frames(socket, parts, caller)

    await serve_stream(socket, parts, exchange)


@router.websocket("/{stream_id}")
async def watch_markers(socket: WebSocket, parts: AppParts, stream_id: str) -> None:
    """Show an open stream, until it ends or the client closes."""

    async def show() -> None:
        idle_s = parts.settings.stream_idle_s
        with parts.live.require_channel(stream_id).watch() as viewer:
            await send_until_end(socket, viewer.next_message, _ignore_messages(socket), idle_s, reason="stream-ended")

    await serve_stream(socket, parts, show)


async def _exchange_frames(socket: WebSocket, parts: Parts, caller: Caller) -> None:
    limits = parts.settings
    first = await receive_message(socket, HEADER_BYTES, limits.stream_idle_s)
    max_rate_hz = min(limits.stream_rate_hz, MAX_FRAMES_HZ)
    configuration = parse_configuration(first, MarkerStreamConfiguration, max_rate_hz)
    async with parts.engine.connect() as connection:
        own_sets = await source_marker_sets(connection, caller.name)
    stored = configuration.static_recording_id
    pose = {} if stored is None else await static_pose(parts, stored)
    task = MarkerStreamTask(configuration=configuration, marker_sets=own_sets, static_world_m=pose)
    channel, rate = LiveChannel(configuration), SampleRateLimiter(max_rate_hz)
    async with parts.pool.open_session(ESTIMATOR, memory_mb=MEMORY_MB, live=True) as estimator:
        answer = Parcel.from_json(await ask_estimator(estimator, {"header": task.model_dump(mode="json")}))
        ready = MarkerStreamReady.model_validate_json(answer.content)
        channel.marker_set = ready.marker_set
        with parts.live.announce(channel):
            ready = ready.model_copy(update={"stream_id": channel.stream_id})
            await socket.send_text(f'{{"ready":{ready.model_dump_json()}}}')
            async with _receiving(socket, limits) as (waiting, receiving):
                while True:
                    frames = [await await_first(waiting.get(), receiving)]
                    while not waiting.empty():
                        frames.append(waiting.get_nowait())
                    value = await ask_estimator(estimator, {"frames": [frame.to_json() for frame in frames]})
                    rate.count_samples(len(frames))
                    for answer in map(Parcel.from_json, value["answers"]):
                        async with asyncio.timeout(limits.stream_idle_s):
                            await socket.send_text(answer.content.decode())
                        if answer.picture:
                            channel.publish(answer.picture)


@asynccontextmanager
async def _receiving(
    socket: WebSocket, limits: Settings
) -> AsyncIterator[tuple[asyncio.Queue[Parcel], asyncio.Task[None]]]:
    """Receive frames beside the estimation, so that those which wait are known; a full queue stops the client."""
    waiting: asyncio.Queue[Parcel] = asyncio.Queue(MAX_WAITING)

    async def receive() -> None:
        while True:
            frame = await receive_message(socket, limits.stream_message_kb * 1000, limits.stream_idle_s)
            if frame.kind != TEXT:
                raise InvalidInput("wrong-format", "A frame is a text message.")
            await waiting.put(frame)

    async with running_beside(receive()) as receiving:
        yield waiting, receiving


async def _ignore_messages(socket: WebSocket) -> None:
    """Ignore what the client sends, until it closes: raises ``WebSocketDisconnect`` then."""
    while True:
        await receive_message(socket, HEADER_BYTES, None)
