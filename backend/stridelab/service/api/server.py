"""The web server, and the second one that renders pages for it: a process each."""

import asyncio
import gc
import os
import socket
from collections.abc import Callable
from types import FrameType
from urllib.parse import urlsplit

import uvicorn
from fastapi import FastAPI

from stridelab.errors import InvalidInput, Unavailable
from stridelab.machine import heartbeat
from stridelab.service import telemetry
from stridelab.service.api.app import create_app
from stridelab.service.api.connection_limits import BACKLOG, ConnectionLimiter, guarded_protocol, raise_file_limit
from stridelab.service.api.dependencies import Parts
from stridelab.service.logging import configure_logging
from stridelab.service.processes import confinement
from stridelab.service.settings import Settings
from stridelab.service.settings import current_settings as load_settings

WS_MAX_BYTES = 64 * 1024 * 1024
SHUTDOWN_GRACE_S = 2
_LOOPBACK_PROXY = "127.0.0.1"
COLLECTOR_THRESHOLDS = (700, 10, 10)
"""Python's own, which ``__main__`` changes for the imports."""


class Server(uvicorn.Server):
    """A uvicorn server that sets ``Parts.closing`` on a stop signal, so that open streams end without delay."""

    def __init__(self, app: FastAPI, config: uvicorn.Config) -> None:
        super().__init__(config)
        self._app = app

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Start the heartbeat, then the server; called in the event loop."""
        self._beating = asyncio.create_task(heartbeat.write_heartbeats())
        await super().startup(sockets)

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        """Handle SIGINT and SIGTERM."""
        super().handle_exit(sig, frame)
        if isinstance(parts := getattr(self._app.state, "parts", None), Parts):
            parts.closing.set()


def build_server(settings: Settings) -> uvicorn.Server:
    """Build the server without running it.

    Raises ``InvalidInput`` (``token-needed``) for an address other than loopback without a token.
    """
    if not settings.is_loopback and settings.token is None:
        raise InvalidInput(
            "token-needed",
            f"{settings.host} can be reached by others: set STRIDELAB_API_TOKEN or STRIDELAB_API_TOKEN_FILE first.",
        )
    proxies = os.environ.get("FORWARDED_ALLOW_IPS", _LOOPBACK_PROXY)
    return _make_server(settings, create_app(settings, with_sample=True), settings.host, settings.port, proxies)


def build_page_server(settings: Settings) -> uvicorn.Server:
    """Build the second web server, at ``settings.pages_url``; the first one relays to it.

    Raises ``InvalidInput`` (``pages-url-invalid``) unless that names a host and a port.
    """
    address = urlsplit(settings.pages_url or "")
    if address.hostname is None or address.port is None:
        raise InvalidInput("pages-url-invalid", "STRIDELAB_PAGES_URL must be http://HOST:PORT.")
    app = create_app(settings.model_copy(update={"pages_url": None}), for_pages=True)
    return _make_server(settings, app, address.hostname, address.port, _LOOPBACK_PROXY)


def _make_server(settings: Settings, app: FastAPI, host: str, port: int, proxies: str) -> uvicorn.Server:
    limiter = ConnectionLimiter.from_settings(settings, raise_file_limit(), proxies)
    config = uvicorn.Config(
        app,
        host=host,
        port=port,
        forwarded_allow_ips=proxies,
        http=guarded_protocol(limiter),
        backlog=BACKLOG,
        timeout_keep_alive=settings.keep_alive_s,
        ws_max_size=WS_MAX_BYTES,
        log_config=None,
        access_log=False,
        server_header=False,
        timeout_graceful_shutdown=SHUTDOWN_GRACE_S,
    )
    return Server(app, config)


def main() -> None:
    """Serve until SIGINT or SIGTERM."""
    _run_server(build_server, "api")


def run_page_server() -> None:
    """Render pages for the first web server until SIGINT or SIGTERM."""
    _run_server(build_page_server, "pages")


def _run_server(build: Callable[[Settings], uvicorn.Server], name: str) -> None:
    settings = load_settings()
    configure_logging(settings.log_level)
    try:
        confinement.check_sandbox_settings(settings)
        with telemetry.export_spans(settings.otlp_url, name):
            server = build(settings)
            gc.freeze()  # modules, schemas and templates: no collection looks at them again
            gc.set_threshold(*COLLECTOR_THRESHOLDS)
            server.run()
    except (InvalidInput, Unavailable) as error:
        raise SystemExit(error.message) from error
