"""``python -m stridelab.service.api``: the web server, one process."""

import uvicorn

from stridelab.errors import InvalidInput
from stridelab.service.api.app import create_app
from stridelab.service.logs import configure_logging
from stridelab.service.settings import Settings
from stridelab.service.settings import settings as load_settings

WS_MAX_BYTES = 64 * 1024 * 1024
GRACE_S = 2


def server(settings: Settings) -> uvicorn.Server:
    """The server, not yet running. Raises ``InvalidInput`` (``token-needed``) for an open address without a token."""
    if not settings.is_loopback and settings.token is None:
        raise InvalidInput(
            "token-needed",
            f"{settings.host} can be reached by others: set STRIDELAB_API_TOKEN or STRIDELAB_API_TOKEN_FILE first.",
        )
    config = uvicorn.Config(
        create_app(settings, with_sample=True),
        host=settings.host,
        port=settings.port,
        ws_max_size=WS_MAX_BYTES,
        log_config=None,
        access_log=False,
        server_header=False,
        timeout_graceful_shutdown=GRACE_S,
    )
    return uvicorn.Server(config)


def main() -> None:
    """Serve until told to stop."""
    settings = load_settings()
    configure_logging(settings.log_level)
    try:
        server(settings).run()
    except InvalidInput as error:
        raise SystemExit(error.message) from error


if __name__ == "__main__":
    main()
