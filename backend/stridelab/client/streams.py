"""Online estimation: sends samples over a websocket and receives estimates."""

import asyncio
import contextlib
import math
import struct
from collections.abc import AsyncGenerator, AsyncIterator, Callable, Generator, Iterator, Mapping, Sequence
from contextlib import asynccontextmanager, contextmanager
from dataclasses import dataclass
from typing import Any, Final, TypeVar

from pydantic import ValidationError
from websockets.asyncio.client import ClientConnection
from websockets.asyncio.client import connect as connect_async
from websockets.exceptions import ConnectionClosed, InvalidHandshake, InvalidStatus
from websockets.sync.client import ClientConnection as SyncConnection
from websockets.sync.client import connect as connect_sync

from stridelab.client.connection import unreachable_error
from stridelab.client.endpoints import API
from stridelab.client.errors import ClientError, ProblemError, Unreachable
from stridelab.schemas.base import Contract, Problem
from stridelab.schemas.streams import (
    PACKED_ROW,
    PACKED_TIME,
    FrameEstimate,
    MarkerFrame,
    MarkerStreamAnswer,
    MarkerStreamReady,
    StreamAnswer,
    StreamEstimate,
    StreamReady,
    StreamSample,
    StreamSamples,
)

STREAM_PATH: Final = f"{API}/stream/com"
MARKERS_PATH: Final = f"{API}/stream/markers"
ANSWER_BYTES: Final = 16_000_000
"""Maximum size of a received message."""

Stream = TypeVar("Stream")


@dataclass(frozen=True)
class Address:
    """A service and how it is connected to."""

    base: str
    headers: Mapping[str, str]
    timeout_s: float

    def websocket(self, path: str) -> str:
        """Address of a stream: ``http`` -> ``ws``, ``https`` -> ``wss``."""
        return f"ws{self.base.removeprefix('http').rstrip('/')}{path}"

    @property
    def options(self) -> dict[str, Any]:
        """Arguments of both functions that open a websocket."""
        return {
            "additional_headers": self.headers,
            "user_agent_header": None,
            "compression": None,
            "open_timeout": self.timeout_s,
            "max_size": ANSWER_BYTES,
        }


_TIME: Final = struct.Struct(PACKED_TIME)
_ROW: Final = struct.Struct(PACKED_ROW)
_NOTHING: Final = (math.nan, math.nan, math.nan)


class AsyncComStream:
    """An open stream; ``ready`` describes the estimator that the service uses."""

    def __init__(self, connection: ClientConnection, answer: str | bytes) -> None:
        self._connection, self.ready = connection, _parse_ready(answer)

    async def send(self, samples: Sequence[StreamSample]) -> list[StreamEstimate]:
        """Send samples and wait for the estimates at them, one per sample.

        Raises ``ProblemError`` where the service refuses them; it then closes the stream.
        """
        return decode_estimates(await exchange_async(self._connection, encode_samples(samples, self.ready.format)))


class ComStream:
    """An open stream; ``ready`` describes the estimator that the service uses."""

    def __init__(self, connection: SyncConnection, answer: str | bytes) -> None:
        self._connection, self.ready = connection, _parse_ready(answer)

    def send(self, samples: Sequence[StreamSample]) -> list[StreamEstimate]:
        """Send samples and wait for the estimates at them, one per sample.

        Raises ``ProblemError`` where the service refuses them; it then closes the stream.
        """
        return decode_estimates(exchange_sync(self._connection, encode_samples(samples, self.ready.format)))


class AsyncMarkerStream:
    """An open stream of markers; ``ready`` says what the service recognised, and what is missing."""

    def __init__(self, connection: ClientConnection, answer: str | bytes) -> None:
        self._connection, self.ready = connection, _parse_marker_ready(answer)

    async def send(self, frame: MarkerFrame) -> FrameEstimate:
        """Send a frame and wait for the estimate at it. Raises ``ProblemError`` where the service refuses it."""
        return _parse_frame(await exchange_async(self._connection, frame.model_dump_json()))

    async def follow(self, frames: AsyncIterator[MarkerFrame]) -> AsyncGenerator[FrameEstimate, None]:
        """Send frames as they arrive, without waiting for answers, and yield the estimates in the order of the frames.

        Ends when ``frames`` has ended and every frame is answered. Raises ``ProblemError`` where the service refuses a
        frame, and the errors of ``frames``.
        """
        sent = 0

        async def send_frames() -> None:
            nonlocal sent
            async for frame in frames:
                with contextlib.suppress(ConnectionClosed):  # the reason of the close is in the receive buffer
                    await self._connection.send(frame.model_dump_json())
                sent += 1

        answered = 0
        sending = asyncio.ensure_future(send_frames())
        receiving = asyncio.ensure_future(self._connection.recv())
        try:
            while not sending.done() or answered < sent:
                waited_for = {receiving} if sending.done() else {sending, receiving}
                await asyncio.wait(waited_for, return_when=asyncio.FIRST_COMPLETED)
                if sending.done():
                    sending.result()
                if receiving.done():
                    try:
                        raw = receiving.result()
                    except ConnectionClosed as error:
                        raise _closed_error(error) from error
                    answered += 1
                    receiving = asyncio.ensure_future(self._connection.recv())
                    yield _parse_frame(raw)
        finally:
            sending.cancel()
            receiving.cancel()
            await asyncio.gather(sending, receiving, return_exceptions=True)


class MarkerStream:
    """An open stream of markers; ``ready`` says what the service recognised, and what is missing."""

    def __init__(self, connection: SyncConnection, answer: str | bytes) -> None:
        self._connection, self.ready = connection, _parse_marker_ready(answer)

    def send(self, frame: MarkerFrame) -> FrameEstimate:
        """Send a frame and wait for the estimate at it. Raises ``ProblemError`` where the service refuses it."""
        return _parse_frame(exchange_sync(self._connection, frame.model_dump_json()))


@asynccontextmanager
async def open_async(
    url: Address, path: str, configuration: Contract, begin: Callable[[ClientConnection, str | bytes], Stream]
) -> AsyncIterator[Stream]:
    """Open a stream for the duration of the context; ``begin`` makes it of the service's first answer."""
    with _translate_errors(url.base):
        connection = await connect_async(url.websocket(path), **url.options)
    async with connection:
        yield begin(connection, await exchange_async(connection, configuration.model_dump_json()))


@contextmanager
def open_sync(
    url: Address, path: str, configuration: Contract, begin: Callable[[SyncConnection, str | bytes], Stream]
) -> Iterator[Stream]:
    """Open a stream for the duration of the context; ``begin`` makes it of the service's first answer."""
    with _translate_errors(url.base):
        connection = connect_sync(url.websocket(path), **url.options)
    with connection:
        yield begin(connection, exchange_sync(connection, configuration.model_dump_json()))


async def watch_async(url: Address, path: str) -> AsyncGenerator[str, None]:
    """Yield the messages of a websocket that nothing is sent on, until the service closes it."""
    with _translate_errors(url.base):
        connection = await connect_async(url.websocket(path), **url.options)
    async with connection:
        with contextlib.suppress(ConnectionClosed):
            async for message in connection:
                yield str(message)


def watch_sync(url: Address, path: str) -> Generator[str, None, None]:
    """Yield the messages of a websocket that nothing is sent on, until the service closes it."""
    with _translate_errors(url.base):
        connection = connect_sync(url.websocket(path), **url.options)
    with connection, contextlib.suppress(ConnectionClosed):
        for message in connection:
            yield str(message)


async def exchange_async(connection: ClientConnection, sent: str | bytes) -> str | bytes:
    """Send one message and receive the next one."""
    with contextlib.suppress(ConnectionClosed):  # the reason of the close may still be in the receive buffer
        await connection.send(sent)
    try:
        return await connection.recv()
    except ConnectionClosed as error:
        raise _closed_error(error) from error


def exchange_sync(connection: SyncConnection, sent: str | bytes) -> str | bytes:
    """Send one message and receive the next one."""
    with contextlib.suppress(ConnectionClosed):
        connection.send(sent)
    try:
        return connection.recv()
    except ConnectionClosed as error:
        raise _closed_error(error) from error


def encode_samples(samples: Sequence[StreamSample], stream_format: str) -> str | bytes:
    """Encode samples as JSON, or packed."""
    if stream_format == "json":
        return StreamSamples(samples=list(samples)).model_dump_json()
    start_s = samples[0].time_s if samples else 0.0
    rows = [
        _ROW.pack(
            sample.time_s - start_s,
            *(sample.geometry_m or _NOTHING),
            *(sample.force_n or _NOTHING),
            *(sample.moment_nm or _NOTHING),
        )
        for sample in samples
    ]
    return _TIME.pack(start_s) + b"".join(rows)


def decode_estimates(raw: str | bytes) -> list[StreamEstimate]:
    """Decode estimates from JSON or packed. Raises ``ProblemError`` if the message is a problem."""
    if isinstance(raw, str):
        return _parse_answer(raw).samples or []
    if len(raw) < _TIME.size or (len(raw) - _TIME.size) % _ROW.size:
        raise _unparsable_error()
    (start_s,) = _TIME.unpack_from(raw)
    return [
        StreamEstimate(time_s=start_s + row[0], com_m=row[1:4], velocity_m_s=row[4:7], sd_m=row[7:10])
        for row in _ROW.iter_unpack(raw[_TIME.size :])
    ]


def _parse_answer(raw: str | bytes) -> StreamAnswer:
    try:
        answer = StreamAnswer.model_validate_json(raw, extra="ignore")
    except ValidationError as error:
        raise _unparsable_error() from error
    if answer.problem is not None:
        raise ProblemError(answer.problem)
    return answer


def _parse_marker_ready(raw: str | bytes) -> MarkerStreamReady:
    try:
        answer = MarkerStreamAnswer.model_validate_json(raw, extra="ignore")
    except ValidationError as error:
        raise _unparsable_error() from error
    if answer.problem is not None:
        raise ProblemError(answer.problem)
    if answer.ready is None:
        raise _unparsable_error()
    return answer.ready


def _parse_frame(raw: str | bytes) -> FrameEstimate:
    try:
        return FrameEstimate.model_validate_json(raw, extra="ignore")
    except ValidationError:
        _parse_marker_ready(raw)  # raises the problem that it may be
        raise _unparsable_error() from None


def _parse_ready(raw: str | bytes) -> StreamReady:
    ready = _parse_answer(raw).ready
    if ready is None:
        raise _unparsable_error()
    return ready


def _unparsable_error() -> ClientError:
    return ClientError("the service sent a message on the stream that this client cannot parse")


def _closed_error(error: ConnectionClosed) -> ClientError:
    why = "" if error.rcvd is None else f" ({error.rcvd.code} {error.rcvd.reason})".replace(" )", ")")
    return Unreachable(f"the service has closed the stream{why}")


@contextmanager
def _translate_errors(base_url: str) -> Iterator[None]:
    """Convert errors of opening a websocket to the errors of the other calls."""
    try:
        yield
    except InvalidStatus as error:
        status = error.response.status_code
        raise ProblemError(
            Problem(
                title=error.response.reason_phrase or "refused",
                status=status,
                code="stream-refused",
                detail="The service refused to open a stream: check the API token and the address.",
            )
        ) from error
    except (OSError, TimeoutError, InvalidHandshake) as error:
        raise unreachable_error(base_url, error) from error
