"""Markers from Qualisys Track Manager by its real-time protocol, with Qualisys' own package ``qtm-rt``.

Labels, rate and vertical axis are those of the project in QTM. Positions are in millimetres; a hidden marker is NaN
there and None here. Time is that of the cameras, in microseconds since the start of the measurement.
"""

import asyncio
import math
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any, Final
from xml.etree import ElementTree

from stridelab.cli.bridges.live_markers import (
    FIRST_FRAME_S,
    LiveMarkers,
    UpAxis,
    missing_package,
    unreachable_system,
)
from stridelab.schemas.streams import MarkerFrame

PORT: Final = 22223
"""QTM's little-endian port."""
PROTOCOL: Final = "1.25"
MAX_WAITING: Final = 100
"""Frames that may wait to be sent; beyond it the oldest is dropped."""
UP_AXES: Final[dict[str, UpAxis]] = {
    "+x": "+x", "-x": "-x", "+y": "+y", "-y": "-y", "+z": "+z", "-z": "-z"
}  # fmt: skip


@asynccontextmanager
async def open_qualisys(host: str, port: int | None = None) -> AsyncIterator[LiveMarkers]:
    """Stream labelled markers from QTM at ``host``, while it measures or plays a file in real time.

    Raises ``Unavailable`` (``package-missing``, ``system-unreachable``).
    """
    try:
        import qtm_rt
    except ModuleNotFoundError as error:
        raise missing_package("Qualisys", "qtm-rt") from error
    waiting: asyncio.Queue[MarkerFrame | None] = asyncio.Queue()

    def put_frame(packet: Any) -> None:
        found = packet.get_3d_markers()
        if found is None:
            return
        if waiting.qsize() >= MAX_WAITING:
            waiting.get_nowait()
        markers = [None if math.isnan(m.x + m.y + m.z) else (m.x, m.y, m.z) for m in found[1]]
        waiting.put_nowait(MarkerFrame(t_s=1e-6 * packet.timestamp, markers=markers))

    def end_frames(_reason: object) -> None:
        waiting.put_nowait(None)

    connection = await qtm_rt.connect(
        host, port or PORT, version=PROTOCOL, on_disconnect=end_frames, timeout=FIRST_FRAME_S
    )
    if connection is None:
        raise unreachable_system("Qualisys", host, "no connection to its real-time server.")
    try:
        labels, rate_hz, up_axis = _read_settings(host, await connection.get_parameters(["general", "3d"]))
        await connection.stream_frames(components=["3d"], on_packet=put_frame)
        yield LiveMarkers(labels, rate_hz, up_axis, _until_none(waiting))
    except (TimeoutError, qtm_rt.QRTCommandException) as error:
        reason = "it did not answer in time." if isinstance(error, TimeoutError) else f"it answered {error}."
        raise unreachable_system("Qualisys", host, reason) from error
    finally:
        if connection.has_transport():
            connection.disconnect()


def _read_settings(host: str, xml: bytes) -> tuple[list[str], float, UpAxis]:
    """Labels, frames per second and vertical axis from QTM's parameters."""
    try:
        root = ElementTree.fromstring(xml)  # noqa: S314 - of the laboratory's own system
    except ElementTree.ParseError as error:
        raise unreachable_system("Qualisys", host, "its settings cannot be read.") from error
    labels = [name.text or "" for name in root.findall("./The_3D/Label/Name")]
    rate = root.findtext("./General/Frequency")
    up_axis = UP_AXES.get((root.findtext("./The_3D/AxisUpwards") or "+z").lower())
    if not labels or rate is None or up_axis is None:
        raise unreachable_system("Qualisys", host, "its project has no labelled markers.")
    return labels, float(rate), up_axis


async def _until_none(waiting: asyncio.Queue[MarkerFrame | None]) -> AsyncIterator[MarkerFrame]:
    while (frame := await waiting.get()) is not None:
        yield frame
