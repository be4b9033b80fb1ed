"""Labelled markers as a motion-capture system sends them, and the systems that can be read."""

from collections.abc import AsyncIterator
from contextlib import AbstractAsyncContextManager
from dataclasses import dataclass
from typing import Final, Literal
from urllib.parse import urlsplit

from stridelab.errors import Fault, InvalidInput, Unavailable
from stridelab.schemas.streams import MarkerFrame

UpAxis = Literal["+x", "-x", "+y", "-y", "+z", "-z"]
SCHEMES: Final = ("qualisys", "vicon")
FIRST_FRAME_S: Final = 10.0
"""Longest time for an answer of the system, and for its first frame."""


@dataclass(frozen=True)
class LiveMarkers:
    """Frames of labelled markers in millimetres; every frame has one position per label, None where it is hidden."""

    labels: list[str]
    rate_hz: float
    up_axis: UpAxis
    frames: AsyncIterator[MarkerFrame]


def open_source(address: str) -> AbstractAsyncContextManager[LiveMarkers]:
    """Connect to ``qualisys://host[:port]`` or ``vicon://host[:port]`` for the duration of the context.

    Raises ``InvalidInput`` (``option-invalid``) for another address. On entering, ``Unavailable`` is raised if the
    system's package is not installed (``package-missing``), the system does not answer or sends no labelled markers
    (``system-unreachable``).
    """
    parts = urlsplit(address)
    try:
        host, port = parts.hostname, parts.port
    except ValueError:
        host, port = None, None
    if parts.scheme not in SCHEMES or not host:
        known = " or ".join(f"{scheme}://HOST" for scheme in SCHEMES)
        raise InvalidInput("option-invalid", f"The source is {known}.", [Fault("SOURCE", f"got {address}")])
    if parts.scheme == "qualisys":
        from stridelab.cli.bridges.qualisys import open_qualisys

        return open_qualisys(host, port)
    from stridelab.cli.bridges.vicon import open_vicon

    return open_vicon(host, port)


def missing_package(system: str, package: str) -> Unavailable:
    """The error for a system whose package is not installed."""
    install = f"pip install 'stridelab[{system.lower()}]'"
    return Unavailable("package-missing", f"Reading from {system} needs the package {package}: {install}.")


def unreachable_system(system: str, host: str, reason: str) -> Unavailable:
    """The error for a system that does not answer as it should."""
    return Unavailable("system-unreachable", f"{system} at {host}: {reason}")
