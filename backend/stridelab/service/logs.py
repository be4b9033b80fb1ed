"""Logging: one line per event, JSON unless a person looks at a terminal.

Lines carry the ids that are bound while they are written (``request_id``, ``job_id``, ``attempt``), never file names,
names of people or addresses of clients.
"""

import logging
import sys
from typing import Any, Protocol, runtime_checkable

import structlog

CHATTY = ("uvicorn.access", "procrastinate", "httpx", "httpcore", "alembic", "websockets")
"""Third-party loggers that are heard from warnings upward only; requests are logged by our own edge."""


@runtime_checkable
class Sink(Protocol):
    """Where lines go: a text file, or something like it."""

    def write(self, text: str, /) -> Any:
        """Take some text."""

    def flush(self) -> Any:
        """Pass on what was taken."""

    def isatty(self) -> bool:
        """Whether a person looks on."""


def configure_logging(level: str = "info", stream: Sink | None = None) -> None:
    """Send the lines of structlog and of the standard library to ``stream`` (standard error) in one format.

    Raises ``ValueError`` for an unknown level.
    """
    out: Sink = stream if stream is not None else sys.stderr
    number = logging.getLevelNamesMapping().get(level.upper())
    if number is None:
        raise ValueError(f"unknown log level {level!r}; use debug, info, warning or error")
    shared: list[structlog.typing.Processor] = [
        structlog.contextvars.merge_contextvars,
        structlog.stdlib.add_log_level,
        structlog.stdlib.add_logger_name,
        structlog.processors.TimeStamper(fmt="iso", utc=True),
    ]
    structlog.configure(
        processors=[*shared, structlog.stdlib.ProcessorFormatter.wrap_for_formatter],
        logger_factory=structlog.stdlib.LoggerFactory(),
        wrapper_class=structlog.stdlib.BoundLogger,
        cache_logger_on_first_use=False,
    )
    handler = logging.StreamHandler(out)
    handler.setFormatter(
        structlog.stdlib.ProcessorFormatter(
            foreign_pre_chain=shared,
            processors=[structlog.stdlib.ProcessorFormatter.remove_processors_meta, *_rendering(out)],
        )
    )
    root = logging.getLogger()
    root.handlers[:] = [handler]
    root.setLevel(number)
    for name in CHATTY:
        logging.getLogger(name).setLevel(max(number, logging.WARNING))


def _rendering(out: Sink) -> list[structlog.typing.Processor]:
    if out.isatty():
        # plain: rich traces show local variables, which may be personal
        return [structlog.dev.ConsoleRenderer(exception_formatter=structlog.dev.plain_traceback)]
    return [structlog.processors.format_exc_info, structlog.processors.JSONRenderer()]
