"""Database connections: PostgreSQL through psycopg."""

import select
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any, Final

from sqlalchemy import event
from sqlalchemy.engine import URL, ExceptionContext, make_url
from sqlalchemy.exc import ArgumentError, InternalError, InvalidatePoolError, OperationalError
from sqlalchemy.ext.asyncio import AsyncConnection, AsyncEngine, create_async_engine

from stridelab.errors import InvalidInput
from stridelab.service.settings import Settings
from stridelab.service.storage.migrate import is_migrated, migrate

__all__ = ["connect_autocommit", "database_url", "is_migrated", "libpq_url", "make_engine", "migrate", "parse_url"]

CONNECTION_OPTIONS: Final[dict[str, Any]] = {
    "connect_timeout": 10,
    "keepalives_idle": 10,
    "keepalives_interval": 5,
    "keepalives_count": 3,
    "tcp_user_timeout": 20_000,
}
"""Connection parameters that detect an unreachable server within half a minute."""
IDLE_MS: Final = 120_000
"""Idle-in-transaction timeout of the server, so that a frozen worker does not hold the lock on its job."""


def database_url(settings: Settings) -> str | None:
    """Validated URL of the configured database including the password; None for the embedded database."""
    if settings.database_url is None:
        return None
    parse_url(settings.database_url)
    return libpq_url(str(settings.database_dsn))


def parse_url(url: str) -> URL:
    """A PostgreSQL URL; raises ``InvalidInput`` (``database-url-invalid``) for anything else."""
    try:
        parsed = make_url(url)
    except ArgumentError as error:
        raise InvalidInput("database-url-invalid", "STRIDELAB_DATABASE_URL is not a URL.") from error
    if parsed.get_backend_name() not in {"postgresql", "postgres"}:
        raise InvalidInput("database-url-invalid", "STRIDELAB_DATABASE_URL must begin with postgresql://.")
    return parsed.set(drivername="postgresql")


def libpq_url(url: str) -> str:
    """Connection URL for libpq."""
    return parse_url(url).render_as_string(hide_password=False)


def make_engine(url: str, *, pool_size: int = 16, planner: str = "", autocommit: bool = False) -> AsyncEngine:
    """Asynchronous engine that replaces connections which the server has closed, for example by a restart.

    It opens up to ``pool_size`` connections when needed and leaves them open: a new one for each request of a burst
    would cost the server a new process. ``planner`` are further options of its sessions, as in ``-c enable_sort=off``.
    With ``autocommit``, every statement of every connection is a transaction of its own.
    """
    address = parse_url(url).set(drivername="postgresql+psycopg")
    given = address.query.get("options", "")
    options = f"{given} -c idle_in_transaction_session_timeout={IDLE_MS} {planner}".strip()
    engine = create_async_engine(
        address,
        pool_size=pool_size,
        max_overflow=0,
        isolation_level="AUTOCOMMIT" if autocommit else None,
        connect_args={**CONNECTION_OPTIONS, "application_name": "stridelab", "options": options},
    )
    event.listen(engine.sync_engine, "checkout", _refuse_closed_connection)
    event.listen(engine.sync_engine, "handle_error", _as_lost_connection, retval=True)
    return engine


@asynccontextmanager
async def connect_autocommit(engine: AsyncEngine) -> AsyncIterator[AsyncConnection]:
    """Connection in autocommit mode: every statement is a transaction of its own and takes one round trip.

    An engine with the execution option ``isolation_level`` sets the mode while it takes the connection from the pool; a
    task that is cancelled meanwhile then neither returns the connection nor resets its mode.
    """
    async with engine.connect() as connection:
        try:
            await connection.execution_options(isolation_level="AUTOCOMMIT")
        except BaseException:
            await connection.invalidate()  # the pool must not lend a connection whose mode is unknown
            raise
        yield connection


def _as_lost_connection(context: ExceptionContext) -> OperationalError | None:
    """The error for a session that the server ended after ``IDLE_MS``, as for any other lost connection.

    psycopg has an ``InternalError`` for it, which a worker that was frozen took for a fault of its own: it let the job
    fail.
    """
    if not (context.is_disconnect and isinstance(context.sqlalchemy_exception, InternalError)):
        return None
    return OperationalError(context.statement, context.parameters, context.original_exception)


def _refuse_closed_connection(connection: Any, _record: object, _proxy: object) -> None:
    """Make the pool reconnect if the server has closed an idle connection, which makes its socket readable.

    Unlike a ping, this costs no round trip per checkout.
    """
    socket = select.poll()
    socket.register(connection.driver_connection, select.POLLIN)
    if socket.poll(0):
        raise InvalidatePoolError
