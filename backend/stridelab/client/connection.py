"""Connection settings shared by both clients: address, token, timeouts, retries."""

from typing import Any

import httpx

from stridelab import __version__
from stridelab.client.endpoints import MAX_WAIT_S, Call
from stridelab.client.errors import ProblemError, Unreachable

DEFAULT_URL = "http://127.0.0.1:8000"
RETRY_S = (0.2, 0.5, 1.0, 2.0, 4.0, 8.0)
"""Delays in seconds between attempts to resume an interrupted stream or long poll; then the client gives up."""


def connection_headers(token: str | None) -> dict[str, str]:
    """Headers of every request."""
    headers = {"User-Agent": f"stridelab-client/{__version__}", "Accept": "application/json, */*"}
    if token is not None:
        headers["Authorization"] = f"Bearer {token}"
    return headers


def request_arguments(call: Call[Any], timeout_s: float) -> dict[str, Any]:
    """Arguments of httpx for ``call``; the timeout of a long poll includes its waiting time."""
    arguments: dict[str, Any] = {
        "params": dict(call.params),
        "headers": dict(call.headers),
        "timeout": timeout_s + call.wait_s,
    }
    if call.json is not None:
        arguments["json"] = call.json
    return arguments


def is_temporary(error: Exception) -> bool:
    """Whether a failure may be temporary: the service, its database or a proxy is restarting."""
    return isinstance(error, Unreachable | httpx.TransportError) or (
        isinstance(error, ProblemError) and error.status in (502, 503, 504)
    )


def poll_s(left_s: float | None) -> float:
    """Waiting time of the next long poll, given the remaining time ``left_s`` (None: unlimited)."""
    return MAX_WAIT_S / 2 if left_s is None else max(0.0, min(MAX_WAIT_S / 2, left_s))


def unreachable_error(base_url: str, error: Exception) -> Unreachable:
    """Error for a service that does not answer."""
    return Unreachable(f"the service at {base_url} does not answer ({type(error).__name__})")
