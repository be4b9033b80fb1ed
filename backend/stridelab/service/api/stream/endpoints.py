"""``WS /stream/com``: online estimation of the centre of mass, and what all streams share.

A separate process per stream computes the estimates; the server forwards messages and enforces limits. An error is
reported in a final text message ``{"problem": ...}``; the close code is then 4000 plus the HTTP status of the problem,
and the close reason is its code.
"""

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable, Coroutine, Mapping
from contextlib import asynccontextmanager, suppress
from typing import Any, Final, TypeVar

import structlog
from fastapi import APIRouter
from pydantic import ValidationError
from starlette.websockets import WebSocket, WebSocketDisconnect

from stridelab.errors import Fault, InvalidInput, StridelabError, TooLarge
from stridelab.schemas.base import Problem
from stridelab.schemas.streams import MarkerStreamConfiguration, StreamAnswer, StreamConfiguration
from stridelab.service.api.dependencies import AppParts, Parts
from stridelab.service.api.problems import faults_of, make_problem, problem_of
from stridelab.service.api.shutdown import await_unless
from stridelab.service.api.stream.limits import SampleRateLimiter
from stridelab.service.api.stream.messages import PACKED, TEXT, Parcel
from stridelab.service.api.strict_json import parse_json
from stridelab.service.processes.pool import ChildSession, IsolatedPool
from stridelab.service.settings import Settings

T = TypeVar("T")

router = APIRouter()
log = structlog.get_logger(__name__)

ESTIMATOR: Final = "stridelab.service.api.stream.session:StreamAnswerer"
MEMORY_MB: Final = 256
"""Memory limit of a stream's child beyond its libraries."""
CONFIGURATION_BYTES: Final = 10_000
STATUS_BASE: Final = 4000
"""Offset of the close code: 4000 plus the HTTP status of the problem."""
ENDED: Final = 1000
GOING_AWAY: Final = 1001
_FAREWELL_S: Final = 2.0


@router.websocket("/stream/com")
async def stream_com(socket: WebSocket, parts: AppParts) -> None:
    """Estimate the centre of mass of a moving body sample by sample, until the client closes."""

    async def exchange() -> None:
        with parts.streams.reserve_place():
            await _exchange_messages(socket, parts.settings, parts.pool)

    await serve_stream(socket, parts, exchange)


async def serve_stream(socket: WebSocket, parts: Parts, exchange: Callable[[], Awaitable[None]]) -> None:
    """Accept a stream and run ``exchange`` to its end, or until the server stops."""
    await socket.accept()
    with suppress(WebSocketDisconnect):
        if await await_unless(parts.closing, _run_exchange(socket, parts, exchange)) is None:
            await socket.close(GOING_AWAY, "service-stops")


async def _run_exchange(socket: WebSocket, parts: Parts, exchange: Callable[[], Awaitable[None]]) -> bool:
    """Run a stream to its end and report errors to the client; returns True."""
    idle_s = parts.settings.stream_idle_s
    try:
        await exchange()
    except StridelabError as refusal:
        await _send_problem(socket, problem_of(refusal))
    except TimeoutError:
        await _send_problem(
            socket, make_problem(408, "stream-idle", f"The client sent or read nothing for {idle_s:g} s.")
        )
    except WebSocketDisconnect:
        raise
    except Exception:
        log.exception("stream broke")
        await _send_problem(socket, make_problem(500, "internal-error", "Something went wrong inside the service."))
    return True


async def _exchange_messages(socket: WebSocket, limits: Settings, pool: IsolatedPool) -> None:
    idle_s = limits.stream_idle_s
    first = await receive_message(socket, CONFIGURATION_BYTES, idle_s)
    configuration = parse_configuration(first, StreamConfiguration, limits.stream_rate_hz)
    rate = SampleRateLimiter(limits.stream_rate_hz)
    async with pool.open_session(ESTIMATOR, memory_mb=MEMORY_MB, live=True) as estimator:
        parcel = Parcel(TEXT, configuration.model_dump_json().encode())
        while True:
            answer = Parcel.from_json(await ask_estimator(estimator, parcel.to_json()))
            rate.count_samples(answer.samples)
            async with asyncio.timeout(idle_s):
                if answer.kind == PACKED:
                    await socket.send_bytes(answer.content)
                else:
                    await socket.send_text(answer.content.decode())
            parcel = await receive_message(socket, limits.stream_message_kb * 1000, idle_s)


async def send_until_end(
    socket: WebSocket,
    next_message: Callable[[], Coroutine[Any, Any, str | None]],
    receive: Coroutine[Any, Any, None],
    idle_s: float,
    *,
    reason: str,
) -> None:
    """Send messages to a viewer while ``receive`` handles what the client sends; None closes with ``reason``."""
    async with running_beside(receive) as receiving:
        while (message := await await_first(next_message(), receiving)) is not None:
            async with asyncio.timeout(idle_s):
                await socket.send_text(message)
        await socket.close(ENDED, reason)


@asynccontextmanager
async def running_beside(work: Coroutine[Any, Any, None]) -> AsyncIterator[asyncio.Task[None]]:
    """A task of ``work``, cancelled at the end of the context."""
    task = asyncio.ensure_future(work)
    try:
        yield task
    finally:
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)


async def await_first(wanted: Coroutine[Any, Any, T], beside: asyncio.Task[None]) -> T:
    """The result of ``wanted``; raises what ends ``beside`` before."""
    getting = asyncio.ensure_future(wanted)
    try:
        await asyncio.wait({getting, beside}, return_when=asyncio.FIRST_COMPLETED)
        if not getting.done():
            beside.result()
        return getting.result()
    finally:
        getting.cancel()


async def ask_estimator(estimator: ChildSession, task: Mapping[str, Any]) -> dict[str, Any]:
    """The child's answer to ``task``.

    Raises the child's error, or ``StridelabError`` with code ``stream-failed`` (the child died) or ``stream-stuck`` (no
    answer in time).
    """
    outcome = await estimator.run(task)
    if outcome.state == "ok":
        return dict(outcome.value)
    if outcome.error_class is not None:
        raise outcome.as_error()
    log.error("stream failed", state=outcome.state, log_tail=outcome.log_tail[-2000:])
    if outcome.state == "timeout":
        raise StridelabError("stream-stuck", "The estimator of this stream does not respond.")
    raise StridelabError("stream-failed", "The estimator of this stream ended unexpectedly.")


async def receive_message(socket: WebSocket, limit_bytes: int, idle_s: float | None) -> Parcel:
    """Receive the next message. Raises ``TimeoutError`` after ``idle_s``, ``TooLarge`` (``message-too-large``)."""
    async with asyncio.timeout(idle_s):
        message = await socket.receive()
    if message["type"] == "websocket.disconnect":
        raise WebSocketDisconnect(message.get("code", 1005))
    packed, text = message.get("bytes"), message.get("text")
    parcel = Parcel(TEXT, str(text).encode()) if packed is None else Parcel(PACKED, packed)
    if len(parcel.content) > limit_bytes:
        raise TooLarge(
            "message-too-large",
            f"A message of {len(parcel.content)} bytes exceeds the limit of {limit_bytes}; send fewer samples at once.",
        )
    return parcel


Configuration = TypeVar("Configuration", StreamConfiguration, MarkerStreamConfiguration)


def parse_configuration(first: Parcel, model: type[Configuration], max_rate_hz: float) -> Configuration:
    """Parse the configuration in the first message of a stream.

    Raises ``InvalidInput`` (``not-json``, ``invalid-request``, ``configuration-first``, ``rate-too-high``).
    """
    if first.kind != TEXT:
        raise InvalidInput("configuration-first", "The first message of a stream must be its configuration, as text.")
    parse_json(first.content)
    try:
        configuration = model.model_validate_json(first.content, strict=True)
    except ValidationError as error:
        faults = faults_of(error.errors(include_url=False, include_input=False))
        places = ", ".join(dict.fromkeys(fault.where for fault in faults))
        raise InvalidInput(
            "invalid-request",
            f"The configuration of the stream is not valid: see {places}.",
            [Fault(fault.where, fault.message) for fault in faults],
        ) from error
    if configuration.rate_hz > max_rate_hz:
        raise InvalidInput(
            "rate-too-high",
            f"This service accepts at most {max_rate_hz:g} samples per second per stream.",
            [Fault("rate_hz", f"{configuration.rate_hz:g} is over {max_rate_hz:g}")],
        )
    return configuration


async def _send_problem(socket: WebSocket, why: Problem) -> None:
    """Send the problem and close the socket; give up after ``_FAREWELL_S`` if the client does not read."""
    with suppress(TimeoutError):
        async with asyncio.timeout(_FAREWELL_S):
            await socket.send_text(StreamAnswer(problem=why).model_dump_json(exclude_none=True))
            await socket.close(STATUS_BASE + why.status, why.code)
