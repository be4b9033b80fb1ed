"""``python -m stridelab.service.api``: the web server, one process."""

from types import FrameType

import uvicorn
from fastapi import FastAPI

from stridelab.errors import InvalidInput
from stridelab.service import telemetry
from stridelab.service.api.app import create_app
from stridelab.service.api.parts import Parts
from stridelab.service.logs import configure_logging
from stridelab.service.settings import Settings
from stridelab.service.settings import settings as load_settings

WS_MAX_BYTES = 64 * 1024 * 1024
GRACE_S = 2


class Server(uvicorn.Server):
    """Tells the application at once when it is to stop; otherwise its open streams would hold it up."""

    def __init__(self, app: FastAPI, config: uvicorn.Config) -> None:
        super().__init__(config)
        self._app = app

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        """Called for SIGINT and SIGTERM."""
        super().handle_exit(sig, frame)
        if isinstance(parts := getattr(self._app.state, "parts", None), Parts):
            parts.closing.set()


def server(settings: Settings) -> uvicorn.Server:
    """The server, not yet running. Raises ``InvalidInput`` (``token-needed``) for an open address without a token."""
    if not settings.is_loopback and settings.token is None:
        raise InvalidInput(
            "token-needed",
            f"{settings.host} can be reached by others: set STRIDELAB_API_TOKEN or STRIDELAB_API_TOKEN_FILE first.",
        )
    app = create_app(settings, with_sample=True)
    config = uvicorn.Config(
        app,
        host=settings.host,
        port=settings.port,
        ws_max_size=WS_MAX_BYTES,
        log_config=None,
        access_log=False,
        server_header=False,
        timeout_graceful_shutdown=GRACE_S,
    )
    return Server(app, config)


def main() -> None:
    """Serve until told to stop."""
    settings = load_settings()
    configure_logging(settings.log_level)
    try:
        with telemetry.exported(settings.otlp_url, "api"):
            server(settings).run()
    except InvalidInput as error:
        raise SystemExit(error.message) from error


if __name__ == "__main__":
    main()
