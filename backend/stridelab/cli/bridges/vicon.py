"""Markers from Vicon Nexus or Tracker by the DataStream SDK, with the package ``pyvicon-datastream``.

The labels are those of the first subject. Positions are in millimetres with z up, the SDK's default axes; a hidden
marker is None. Time is the number of the frame over the rate.
"""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any, Final, Protocol, runtime_checkable

from stridelab.cli.bridges.live_markers import FIRST_FRAME_S, LiveMarkers, missing_package, unreachable_system
from stridelab.schemas.streams import MarkerFrame

PORT: Final = 801
RETRY_S: Final = 0.002
"""Pause before the SDK is asked again for a frame that is not there yet."""
LOST_S: Final = 5.0
"""Time without a frame after which the stream has ended."""


@runtime_checkable
class DataStream(Protocol):
    """What is used of ``PyViconDatastream``; its calls return a result code or a value, None where there is none."""

    def connect(self, ip: str) -> Any: ...
    def disconnect(self) -> Any: ...
    def is_connected(self) -> bool: ...
    def enable_marker_data(self) -> Any: ...
    def get_frame(self) -> Any: ...
    def get_frame_number(self) -> int: ...
    def get_frame_rate(self) -> float: ...
    def get_subject_count(self) -> int: ...
    def get_subject_name(self, index: int) -> str: ...
    def get_marker_count(self, name: str) -> int: ...
    def get_marker_name(self, name: str, index: int) -> str: ...
    def get_marker_global_translation(self, subject_name: str, marker_name: str) -> Any: ...


@asynccontextmanager
async def open_vicon(host: str, port: int | None = None) -> AsyncIterator[LiveMarkers]:
    """Stream the markers of the first subject from the DataStream server at ``host``.

    Raises ``Unavailable`` (``package-missing``, ``system-unreachable``).
    """
    try:
        from pyvicon_datastream import PyViconDatastream, Result
    except ModuleNotFoundError as error:
        raise missing_package("Vicon", "pyvicon-datastream") from error
    client: DataStream = PyViconDatastream()
    async with stream_of_client(client, Result.Success, f"{host}:{port or PORT}") as live:
        yield live


@asynccontextmanager
async def stream_of_client(client: DataStream, success: object, address: str) -> AsyncIterator[LiveMarkers]:
    """Connect ``client`` to ``address`` (host:port); ``success`` is the result code of a call that succeeded."""
    if await asyncio.to_thread(client.connect, address) != success or not client.is_connected():
        raise unreachable_system("Vicon", address, "no connection to its DataStream server.")
    try:
        client.enable_marker_data()
        if not await _next_frame(client, success, FIRST_FRAME_S):
            raise unreachable_system("Vicon", address, "it sends no frames.")
        subject = client.get_subject_name(0) if client.get_subject_count() else None
        count = 0 if subject is None else client.get_marker_count(subject)
        if subject is None or not count:
            raise unreachable_system("Vicon", address, "it sends no subject with labelled markers.")
        labels = [client.get_marker_name(subject, index) for index in range(count)]
        rate_hz = client.get_frame_rate()
        yield LiveMarkers(labels, rate_hz, "+z", _read_frames(client, success, subject, labels, rate_hz))
    finally:
        client.disconnect()


async def _read_frames(
    client: DataStream, success: object, subject: str, labels: list[str], rate_hz: float
) -> AsyncIterator[MarkerFrame]:
    while True:
        markers = [_position_of(client, subject, label) for label in labels]
        yield MarkerFrame(t_s=client.get_frame_number() / rate_hz, markers=markers)
        if not await _next_frame(client, success, LOST_S):
            return


def _position_of(client: DataStream, subject: str, label: str) -> tuple[float, float, float] | None:
    position = client.get_marker_global_translation(subject, label)
    if position is None:
        return None
    x, y, z = (float(value) for value in position)
    return None if x == y == z == 0.0 else (x, y, z)


async def _next_frame(client: DataStream, success: object, longest_s: float) -> bool:
    """Wait for the next frame; False if there is none for ``longest_s`` or the connection is lost."""
    loop = asyncio.get_running_loop()
    until_s = loop.time() + longest_s
    while await asyncio.to_thread(client.get_frame) != success:
        if loop.time() > until_s or not client.is_connected():
            return False
        await asyncio.sleep(RETRY_S)
    return True
