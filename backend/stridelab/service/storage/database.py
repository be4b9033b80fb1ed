"""How the database is reached. PostgreSQL only, by psycopg."""

import select
from typing import Any, Final

from sqlalchemy import event
from sqlalchemy.engine import URL, make_url
from sqlalchemy.exc import ArgumentError, InvalidatePoolError
from sqlalchemy.ext.asyncio import AsyncEngine, create_async_engine

from stridelab.errors import InvalidInput
from stridelab.service.settings import Settings
from stridelab.service.storage.migrate import is_migrated, migrate

__all__ = ["conninfo", "database_url", "is_migrated", "make_engine", "migrate", "parse_url", "reading"]

PATIENCE: Final[dict[str, Any]] = {
    "connect_timeout": 10,
    "keepalives_idle": 10,
    "keepalives_interval": 5,
    "keepalives_count": 3,
    "tcp_user_timeout": 20_000,
}
"""Connection parameters that notice a server which vanished from the network within half a minute."""
IDLE_MS: Final = 120_000
"""After this the server ends who does nothing within a transaction: a frozen worker would keep its job locked."""


def database_url(settings: Settings) -> str | None:
    """The configured database, checked, with its password filled in from the file; None for the embedded one."""
    if settings.database_url is None:
        return None
    parse_url(settings.database_url)
    return conninfo(str(settings.database_dsn))


def parse_url(url: str) -> URL:
    """A PostgreSQL URL; raises ``InvalidInput`` (``database-url-invalid``) for anything else."""
    try:
        parsed = make_url(url)
    except ArgumentError as error:
        raise InvalidInput("database-url-invalid", "STRIDELAB_DATABASE_URL is not a URL.") from error
    if parsed.get_backend_name() not in {"postgresql", "postgres"}:
        raise InvalidInput("database-url-invalid", "STRIDELAB_DATABASE_URL must begin with postgresql://.")
    return parsed.set(drivername="postgresql")


def conninfo(url: str) -> str:
    """The URL as libpq takes it."""
    return parse_url(url).render_as_string(hide_password=False)


def make_engine(url: str, *, pool_size: int = 8) -> AsyncEngine:
    """Asynchronous engine; connections are looked at before use, so that a restarted database goes unnoticed."""
    address = parse_url(url).set(drivername="postgresql+psycopg")
    options = f"{address.query.get('options', '')} -c idle_in_transaction_session_timeout={IDLE_MS}".strip()
    engine = create_async_engine(
        address,
        pool_size=pool_size,
        max_overflow=pool_size,
        connect_args={**PATIENCE, "application_name": "stridelab", "options": options},
    )
    event.listen(engine.sync_engine, "checkout", _refuse_ended)
    return engine


def reading(engine: AsyncEngine) -> AsyncEngine:
    """The same connections for single questions: each is its own transaction, asked in one round trip."""
    return engine.execution_options(isolation_level="AUTOCOMMIT")


def _refuse_ended(connection: Any, _record: object, _proxy: object) -> None:
    """Have the pool connect anew where the server has ended a resting connection, which makes its socket readable.

    Asking the server whether it is there would cost every question another round trip.
    """
    socket = select.poll()
    socket.register(connection.driver_connection, select.POLLIN)
    if socket.poll(0):
        raise InvalidatePoolError
