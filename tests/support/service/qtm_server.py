"""A server that speaks the part of Qualisys' real-time protocol that a bridge uses, and plays a recording by it.

Packets are written here from the protocol's description: size and type as two little-endian integers, then the content.
"""

import asyncio
import struct
from collections.abc import AsyncIterator, Mapping
from contextlib import asynccontextmanager, suppress

import numpy as np

COMMAND, XML, DATA, NO_MORE_DATA = 1, 2, 3, 4
MARKERS_3D = 1


def packet(kind: int, content: bytes) -> bytes:
    return struct.pack("<II", 8 + len(content), kind) + content


def settings(labels: list[str], rate_hz: float, up_axis: str = "+Z") -> bytes:
    names = "".join(f"<Label><Name>{label}</Name><RGBColor>255</RGBColor></Label>" for label in labels)
    text = (
        f"<QTM_Parameters_Ver_1.25><General><Frequency>{rate_hz:g}</Frequency></General>"
        f"<The_3D><AxisUpwards>{up_axis}</AxisUpwards><Labels>{len(labels)}</Labels>{names}</The_3D>"
        "</QTM_Parameters_Ver_1.25>"
    )
    return text.encode()


def data_packet(number: int, time_us: int, markers_mm: np.ndarray) -> bytes:
    """One frame of labelled markers; a hidden one is NaN."""
    body = struct.pack("<Ihh", len(markers_mm), 0, 0) + np.asarray(markers_mm, dtype="<f4").tobytes()
    component = struct.pack("<II", 8 + len(body), MARKERS_3D) + body
    return packet(DATA, struct.pack("<qII", time_us, number, 1) + component)


class QtmServer:
    """Plays ``markers_mm`` (label to track) at ``rate_hz``, ``faster`` times as fast, once per client."""

    def __init__(
        self, markers_mm: Mapping[str, np.ndarray], rate_hz: float, *, faster: float = 1.0, up_axis: str = "+Z"
    ) -> None:
        self.labels = list(markers_mm)
        self.tracks = np.stack([*markers_mm.values()], axis=1) if markers_mm else np.zeros((0, 0, 3))
        self.rate_hz, self.faster, self.up_axis = rate_hz, faster, up_axis
        self.commands: list[str] = []
        self._serving: set[asyncio.Task[None]] = set()

    @asynccontextmanager
    async def listening(self) -> AsyncIterator[int]:
        server = await asyncio.start_server(self._serve, "127.0.0.1", 0)
        async with server:
            yield server.sockets[0].getsockname()[1]
        for task in self._serving:
            task.cancel()
        await asyncio.gather(*self._serving, return_exceptions=True)

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = asyncio.current_task()
        assert task is not None
        self._serving.add(task)
        try:
            await self._answer(reader, writer)
        finally:
            writer.close()
            with suppress(ConnectionError):
                await writer.wait_closed()

    async def _answer(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        writer.write(packet(COMMAND, b"QTM RT Interface connected\0"))
        with suppress(ConnectionError, asyncio.IncompleteReadError):
            while True:
                size, _ = struct.unpack("<II", await reader.readexactly(8))
                command = (await reader.readexactly(size - 8)).rstrip(b"\0").decode()
                self.commands.append(command)
                if command.startswith("version"):
                    writer.write(packet(COMMAND, b"Version set to 1.25\0"))
                elif command.startswith("getparameters"):
                    writer.write(packet(XML, settings(self.labels, self.rate_hz, self.up_axis) + b"\0"))
                elif command.startswith("streamframes"):
                    await self._stream(writer)
                    break

    async def _stream(self, writer: asyncio.StreamWriter) -> None:
        for number, markers in enumerate(self.tracks):
            writer.write(data_packet(number, round(1e6 * number / self.rate_hz), markers))
            await writer.drain()
            await asyncio.sleep(1.0 / (self.rate_hz * self.faster))
