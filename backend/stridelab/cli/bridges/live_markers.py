"""Labelled markers as a motion-capture system sends them, and the errors of a system that cannot be read."""

from collections.abc import AsyncIterator
from dataclasses import dataclass
from typing import Final, Literal

from stridelab.errors import Unavailable
from stridelab.schemas.streams import MarkerFrame

UpAxis = Literal["+x", "-x", "+y", "-y", "+z", "-z"]
FIRST_FRAME_S: Final = 10.0
"""Longest time for an answer of the system, and for its first frame."""


@dataclass(frozen=True)
class LiveMarkers:
    """Frames of labelled markers in millimetres; every frame has one position per label, None where it is hidden."""

    labels: list[str]
    rate_hz: float
    up_axis: UpAxis
    frames: AsyncIterator[MarkerFrame]


def missing_package(system: str, package: str) -> Unavailable:
    """The error for a system whose package is not installed."""
    install = f"pip install 'stridelab[{system.lower()}]'"
    return Unavailable("package-missing", f"Reading from {system} needs the package {package}: {install}.")


def unreachable_system(system: str, host: str, reason: str) -> Unavailable:
    """The error for a system that does not answer as it should."""
    return Unavailable("system-unreachable", f"{system} at {host}: {reason}")
