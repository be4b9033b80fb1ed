"""Logging: one line per event, as JSON unless the output is a terminal.

Lines carry the bound context ids (``request_id``, ``job_id``, ``attempt``), never file names, names of subjects or
addresses of clients.
"""

import logging
import sys
import time
from collections import OrderedDict
from collections.abc import Callable
from typing import Any, Final, Protocol, runtime_checkable

import structlog

CHATTY_LOGGERS = ("uvicorn.access", "httpx", "httpcore", "alembic", "websockets")
"""Third-party loggers limited to warnings and errors; requests are logged by the service's own middleware."""


@runtime_checkable
class Sink(Protocol):
    """Text stream that log lines are written to."""

    def write(self, text: str, /) -> Any:
        """Write ``text``."""

    def flush(self) -> Any:
        """Flush buffered text."""

    def isatty(self) -> bool:
        """Whether the stream is a terminal."""


BURST: Final = 50
"""Capacity of the token bucket of one kind of line."""
RATE_HZ: Final = 0.1
"""Refill rate of the bucket: lines of one kind per second after a burst."""
_MAX_KINDS: Final = 1000


class RepeatedLineFilter(logging.Filter):
    """Token-bucket rate limit per kind of line, so that clients cannot flood a log file.

    Applies to warnings, errors, refusals and unauthenticated requests. The next written line of the same kind carries
    the number of suppressed lines in ``left_out``.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        super().__init__()
        self._clock = clock
        self._kinds: OrderedDict[object, tuple[float, float, int]] = OrderedDict()

    def filter(self, record: logging.LogRecord) -> bool:
        """Whether to write ``record``."""
        kind = _kind_of(record)
        if kind is None:
            return True
        now_s = self._clock()
        left, at_s, left_out = self._kinds.pop(kind, (float(BURST), now_s, 0))
        left = min(float(BURST), left + RATE_HZ * (now_s - at_s))
        is_written = left >= 1.0
        self._kinds[kind] = (left - 1.0, now_s, 0) if is_written else (left, now_s, left_out + 1)
        if len(self._kinds) > _MAX_KINDS:
            self._kinds.popitem(last=False)
        if is_written and left_out:
            if isinstance(record.msg, dict):
                record.msg = {**record.msg, "left_out": left_out}
            else:
                record.msg = f"{record.getMessage()} ({left_out} like it left out)"
                record.args = None
        return is_written


def _kind_of(record: logging.LogRecord) -> object:
    """Key under which repeated lines are counted; None for a line that is always written."""
    event = record.msg if isinstance(record.msg, dict) else {}
    is_foreign = event.get("stranger") or event.get("action") == "refused"
    if record.levelno < logging.WARNING and not is_foreign:
        return None
    what = event.get("event", record.msg) if event else record.msg
    error = record.exc_info[0] if record.exc_info else None
    about = (str(event.get(name)) for name in ("route", "status", "action", "what"))
    return record.name, record.levelno, str(what), error, *about


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
            processors=[structlog.stdlib.ProcessorFormatter.remove_processors_meta, *_final_processors(out)],
        )
    )
    handler.addFilter(RepeatedLineFilter())
    root = logging.getLogger()
    root.handlers[:] = [handler]
    root.setLevel(number)
    for name in CHATTY_LOGGERS:
        logging.getLogger(name).setLevel(max(number, logging.WARNING))


def _final_processors(out: Sink) -> list[structlog.typing.Processor]:
    if out.isatty():
        # plain: rich traces show local variables, which may be personal
        return [structlog.dev.ConsoleRenderer(exception_formatter=structlog.dev.plain_traceback)]
    return [structlog.processors.format_exc_info, structlog.processors.JSONRenderer()]
