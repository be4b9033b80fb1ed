"""The motion-capture systems that can be read, by their addresses."""

from contextlib import AbstractAsyncContextManager
from typing import Final
from urllib.parse import urlsplit

from stridelab.cli.bridges.live_markers import LiveMarkers
from stridelab.cli.bridges.qualisys import open_qualisys
from stridelab.cli.bridges.vicon import open_vicon
from stridelab.errors import Fault, InvalidInput

SCHEMES: Final = ("qualisys", "vicon")


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
    return open_qualisys(host, port) if parts.scheme == "qualisys" else open_vicon(host, port)
