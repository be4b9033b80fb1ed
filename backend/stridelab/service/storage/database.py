"""The database: how to reach it, and how it gets its tables. PostgreSQL only, by psycopg.

``migrate`` is safe to call from any number of processes at once: an advisory lock lets one work and the others wait.
"""

import time
from pathlib import Path

import sqlalchemy
from alembic import command
from alembic.config import Config
from alembic.runtime.migration import MigrationContext
from alembic.script import ScriptDirectory
from sqlalchemy.engine import URL, make_url
from sqlalchemy.exc import ArgumentError, DBAPIError
from sqlalchemy.ext.asyncio import AsyncEngine, create_async_engine

from stridelab.errors import InvalidInput, Unavailable
from stridelab.service.settings import Settings

MIGRATIONS = Path(__file__).with_name("migrations")
_MIGRATION_LOCK = 0x5712DE1AB


def database_url(settings: Settings) -> str | None:
    """The configured database with its password filled in from the file, or None for the embedded one."""
    if settings.database_url is None:
        return None
    url = parse_url(settings.database_url)
    if settings.database_password_file is not None:
        url = url.set(password=settings.database_password_file.read_text(encoding="utf-8").strip())
    return url.render_as_string(hide_password=False)


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
        connect_args={"connect_timeout": 10, "application_name": "stridelab"},
    )


def migrate(url: str, *, wait_s: float = 30.0) -> None:
    """Bring the database to the newest revision, waiting up to ``wait_s`` for it to answer.

    Raises ``Unavailable`` (``database-unreachable``), or ``Unavailable`` (``database-newer``) where the tables were
    made by a newer version of this program.
    """
    engine = _sync_engine(url)
    try:
        _wait_until_reachable(engine, wait_s)
        with engine.begin() as connection:
            connection.execute(sqlalchemy.text("SELECT pg_advisory_xact_lock(:key)"), {"key": _MIGRATION_LOCK})
            scripts = ScriptDirectory(str(MIGRATIONS))
            present = MigrationContext.configure(connection).get_current_revision()
            if present is not None and present not in {revision.revision for revision in scripts.walk_revisions()}:
                raise Unavailable(
                    "database-newer",
                    f"The database has revision {present}, which this version does not know; a newer one made it.",
                )
            config = Config()
            config.set_main_option("script_location", str(MIGRATIONS).replace("%", "%%"))
            config.attributes["connection"] = connection
            command.upgrade(config, "head")
    finally:
        engine.dispose()


def is_migrated(url: str) -> bool:
    """Whether the database answers and has the newest tables."""
    engine = _sync_engine(url)
    try:
        with engine.connect() as connection:
            present = MigrationContext.configure(connection).get_current_revision()
    except DBAPIError:
        return False
    finally:
        engine.dispose()
    return present == ScriptDirectory(str(MIGRATIONS)).get_current_head()


def _sync_engine(url: str) -> sqlalchemy.Engine:
    return sqlalchemy.create_engine(
        parse_url(url).set(drivername="postgresql+psycopg"),
        poolclass=sqlalchemy.NullPool,
        connect_args={"connect_timeout": 10},
    )


def _wait_until_reachable(engine: sqlalchemy.Engine, wait_s: float) -> None:
    deadline = time.monotonic() + wait_s
    while True:
        try:
            with engine.connect():
                return
        except DBAPIError as error:
            if time.monotonic() > deadline:
                where = engine.url.render_as_string(hide_password=True)
                raise Unavailable("database-unreachable", f"The database {where} does not answer.") from error
            time.sleep(0.5)
