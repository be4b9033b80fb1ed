"""A door beside a service that counts what passes: bytes both ways, and the messages of websockets.

Headers, WebSocket framing and all: what is counted is what a network would carry above TCP.
"""

import asyncio
import contextlib
import threading
from collections.abc import Iterator
from dataclasses import dataclass, field

PIECE = 65536
LOOK_AGAIN_S = 0.05
FINAL_AND_FIRST = (0x0, 0x1, 0x2)
"""Opcodes of WebSocket frames that carry data: continuation, text, bytes. Pings and closings are none of ours."""
LONG = {126: 2, 127: 8}
"""Where the short length says so, so many bytes of length follow."""


@dataclass
class Wire:
    """One connection; ``said`` and ``heard`` are the data frames of its websocket, by the service and by the page."""

    down_bytes: int = 0
    up_bytes: int = 0
    said: int = 0
    heard: int = 0
    is_socket: bool = False


@dataclass
class Meter:
    """What has passed since the start; ``url`` is where the service is reached through the door.

    Of a connection that has sent ``up_at_most`` bytes nothing more is let through until the number is taken away.
    """

    url: str = ""
    wires: list[Wire] = field(default_factory=list)
    up_at_most: int | None = None

    @property
    def down_bytes(self) -> int:
        """Bytes by the service."""
        return sum(wire.down_bytes for wire in self.wires)

    @property
    def answer_bytes(self) -> int:
        """Those of them outside websockets, which ask now and then whether the other side is there."""
        return sum(wire.down_bytes for wire in self.wires if not wire.is_socket)

    @property
    def said(self) -> int:
        """Messages by the service through websockets."""
        return sum(wire.said for wire in self.wires)

    @property
    def heard(self) -> int:
        """Messages to the service through websockets."""
        return sum(wire.heard for wire in self.wires)


@contextlib.contextmanager
def metered(port: int) -> Iterator[Meter]:
    """A door to the service on the loopback ``port``, in a thread of its own."""
    loop = asyncio.new_event_loop()
    thread = threading.Thread(target=loop.run_forever, daemon=True)
    thread.start()
    meter = Meter()

    async def through(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        wire = Wire()
        meter.wires.append(wire)
        inside, outside = await asyncio.open_connection("127.0.0.1", port)
        both = (_carry(reader, outside, wire, meter), _carry(inside, writer, wire, None))
        with contextlib.suppress(asyncio.CancelledError):  # the end of the door
            await asyncio.gather(*both, return_exceptions=True)

    async def listen() -> asyncio.Server:
        return await asyncio.start_server(through, "127.0.0.1", 0)

    server = asyncio.run_coroutine_threadsafe(listen(), loop).result(10)
    try:
        meter.url = f"http://127.0.0.1:{server.sockets[0].getsockname()[1]}"
        yield meter
    finally:
        asyncio.run_coroutine_threadsafe(_end(server), loop).result(10)
        loop.call_soon_threadsafe(loop.stop)
        thread.join(10)
        loop.close()


async def _end(server: asyncio.Server) -> None:
    server.close()
    others = asyncio.all_tasks() - {asyncio.current_task()}
    for task in others:
        task.cancel()
    await asyncio.gather(*others, return_exceptions=True)


async def _carry(source: asyncio.StreamReader, sink: asyncio.StreamWriter, wire: Wire, up: Meter | None) -> None:
    """Towards the service, under the limit of ``up``, or with None from it."""
    frames = Frames()
    try:
        while piece := await source.read(PIECE):
            if up is not None:
                while up.up_at_most is not None and wire.up_bytes >= up.up_at_most and not source.at_eof():
                    await asyncio.sleep(LOOK_AGAIN_S)
                wire.up_bytes += len(piece)
                wire.is_socket = wire.is_socket or b"upgrade: websocket" in piece[:4096].lower()
            else:
                wire.down_bytes += len(piece)
            if wire.is_socket:
                found = frames.count(piece)
                if up is not None:
                    wire.heard += found
                else:
                    wire.said += found
            sink.write(piece)
            await sink.drain()
    finally:
        sink.close()


class Frames:
    """Counts the data frames of a websocket in one direction, after the heading that opened it."""

    def __init__(self) -> None:
        self._rest = b""
        self._skip = 0
        self._opened = False

    def count(self, piece: bytes) -> int:
        """Data frames that begin in ``piece``."""
        self._rest += piece
        if not self._opened:
            _, mark, rest = self._rest.partition(b"\r\n\r\n")
            if not mark:
                return 0
            self._opened, self._rest = True, rest
        found = 0
        while True:
            passed = min(self._skip, len(self._rest))
            self._skip, self._rest = self._skip - passed, self._rest[passed:]
            if self._skip or len(self._rest) < 2:
                return found
            first, second = self._rest[0], self._rest[1]
            long = LONG.get(second & 0x7F, 0)
            if len(self._rest) < 2 + long:
                return found
            length = int.from_bytes(self._rest[2 : 2 + long]) if long else second & 0x7F
            self._skip = 2 + long + (4 if second & 0x80 else 0) + length
            found += (first & 0x0F) in FINAL_AND_FIRST
