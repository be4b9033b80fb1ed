"""Creates and upgrades the database tables.

``migrate`` may be called by any number of processes at once: an advisory lock lets one work and the others wait. The
check whether an upgrade is needed runs at every start and avoids SQLAlchemy and Alembic, which are slow to import.
"""

import os
import subprocess
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

import psycopg

from stridelab.errors import Unavailable
from stridelab.service.storage import locks

if TYPE_CHECKING:
    import sqlalchemy

MIGRATIONS = Path(__file__).with_name("migrations")


def migrate(url: str, *, wait_s: float = 30.0) -> None:
    """Upgrade the database to the newest revision, waiting up to ``wait_s`` for it to respond.

    Raises ``Unavailable`` (``database-unreachable``), or ``Unavailable`` (``database-newer``) if the tables were
    created by a newer version of this program.
    """
    _wait_until_reachable(url, wait_s)
    present = present_revision(url)
    if present is not None and present not in all_revisions():
        raise Unavailable(
            "database-newer",
            f"The database has revision {present}, which was created by a newer version of stridelab.",
        )
    if present != all_revisions()[-1]:
        _upgrade_database(url)


def migrate_in_child(url: str, *, wait_s: float = 30.0) -> None:
    """``migrate`` with the upgrade in a child: SQLAlchemy and Alembic would remain in this process' memory, 24 MB.

    Raises the errors of ``migrate``.
    """
    _wait_until_reachable(url, wait_s)
    if not is_migrated(url):
        command = [sys.executable, "-m", "stridelab.cli", "migrate"]
        subprocess.run(command, env={**os.environ, "STRIDELAB_DATABASE_URL": url}, capture_output=True, check=False)
    migrate(url, wait_s=wait_s)  # finds nothing to do, or raises the error that ended the child


def is_migrated(url: str) -> bool:
    """Whether the database responds and has the newest revision."""
    try:
        return present_revision(url) == all_revisions()[-1]
    except psycopg.OperationalError:
        return False


def all_revisions() -> list[str]:
    """All revisions in order: each file is named ``<number>_<what>.py``, and the number is the revision."""
    return sorted(file.name.split("_")[0] for file in (MIGRATIONS / "versions").glob("[0-9]*_*.py"))


def present_revision(url: str) -> str | None:
    """The revision of the database's tables; None for an empty database."""
    with psycopg.connect(libpq_address(url), connect_timeout=10, autocommit=True) as connection:
        if connection.execute("SELECT to_regclass('alembic_version')").fetchone() == (None,):
            return None
        row = connection.execute("SELECT version_num FROM alembic_version").fetchone()
    return None if row is None else str(row[0])


def libpq_address(url: str) -> str:
    """The URL in the form of libpq, without SQLAlchemy's driver name."""
    return url.replace("postgresql+psycopg:", "postgresql:", 1)


def engine_of(url: str) -> "sqlalchemy.Engine":
    """A synchronous engine without a connection pool, for one-off work."""
    import sqlalchemy

    address = libpq_address(url).replace("postgresql:", "postgresql+psycopg:", 1)
    return sqlalchemy.create_engine(address, poolclass=sqlalchemy.NullPool)


def upgrade_on(connection: "sqlalchemy.Connection", revision: str) -> None:
    """Run the migrations up to ``revision`` (or ``head``) in the connection's transaction and schema."""
    from alembic import command
    from alembic.config import Config

    config = Config()
    config.set_main_option("script_location", str(MIGRATIONS).replace("%", "%%"))
    config.attributes["connection"] = connection
    command.upgrade(config, revision)


def _upgrade_database(url: str) -> None:
    from sqlalchemy import text

    engine = engine_of(url)
    try:
        with engine.begin() as connection:
            connection.execute(text("SELECT pg_advisory_xact_lock(:key)"), {"key": locks.MIGRATION})
            upgrade_on(connection, "head")
    finally:
        engine.dispose()


def _wait_until_reachable(url: str, wait_s: float) -> None:
    deadline = time.monotonic() + wait_s
    while True:
        try:
            psycopg.connect(libpq_address(url), connect_timeout=10).close()
        except psycopg.OperationalError as error:
            if time.monotonic() > deadline:
                parts = urlsplit(url)
                where = f"{parts.hostname or 'on its socket'}{parts.path}"
                raise Unavailable("database-unreachable", f"The database {where} does not respond.") from error
            time.sleep(0.5)
        else:
            return
