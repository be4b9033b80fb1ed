"""The web server, one process."""

import asyncio
import gc
import os
import socket
from types import FrameType

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
    app = create_app(settings, with_sample=True)
    limiter = ConnectionLimiter.from_settings(settings, raise_file_limit(), os.environ.get("FORWARDED_ALLOW_IPS"))
    config = uvicorn.Config(
        app,
        host=settings.host,
        port=settings.port,
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
    settings = load_settings()
    configure_logging(settings.log_level)
    try:
        confinement.check_sandbox_settings(settings)
        with telemetry.export_spans(settings.otlp_url, "api"):
            server = build_server(settings)
            gc.freeze()  # modules, schemas and templates: no collection looks at them again
            gc.set_threshold(*COLLECTOR_THRESHOLDS)
            server.run()
    except (InvalidInput, Unavailable) as error:
        raise SystemExit(error.message) from error
