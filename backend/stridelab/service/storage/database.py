"""How the database is reached. PostgreSQL only, by psycopg."""

from typing import Any, Final

from sqlalchemy.engine import URL, make_url
from sqlalchemy.exc import ArgumentError
from sqlalchemy.ext.asyncio import AsyncEngine, create_async_engine

from stridelab.errors import InvalidInput
from stridelab.service.settings import Settings
from stridelab.service.storage.migrating import is_migrated, migrate

__all__ = ["conninfo", "database_url", "is_migrated", "make_engine", "migrate", "parse_url"]

PATIENCE: Final[dict[str, Any]] = {
    "connect_timeout": 10,
    "keepalives_idle": 10,
    "keepalives_interval": 5,
    "keepalives_count": 3,
    "tcp_user_timeout": 20_000,
}
"""Connection parameters that notice a server which vanished from the network within half a minute."""


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
    """Asynchronous engine; connections are checked before use, so that a restarted database goes unnoticed."""
    return create_async_engine(
        parse_url(url).set(drivername="postgresql+psycopg"),
        pool_pre_ping=True,
        pool_size=pool_size,
        max_overflow=pool_size,
        connect_args={**PATIENCE, "application_name": "stridelab"},
    )
