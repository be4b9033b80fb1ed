"""Databases for tests: a private PostgreSQL, a migrated database for each test, databases of earlier versions.

Also a database with very many recordings and subjects, for tests and benchmarks of lists.
"""

import asyncio
import json
import os
import shutil
import tempfile
from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import timedelta
from itertools import count
from pathlib import Path
from typing import Any, Final

import psycopg
import sqlalchemy
from alembic.autogenerate import compare_metadata
from alembic.runtime.migration import MigrationContext
from sqlalchemy.ext.asyncio import AsyncEngine

from stridelab.service.jobs.retention import remove_orphans
from stridelab.service.postgres.embedded import EmbeddedPostgres
from stridelab.service.samples.scenario_bodies import ONE_STEP
from stridelab.service.storage.blobs import BlobStore
from stridelab.service.storage.database import make_engine, parse_url
from stridelab.service.storage.migrate import engine_of, migrate, upgrade_on
from stridelab.service.storage.tables import metadata
from support.service.stored_rows import facts

_numbers = count()


@contextmanager
def public_folder() -> Iterator[Path]:
    """A folder that an unprivileged account can reach, so that root's server lies in it; removed at the end."""
    folder = Path(tempfile.mkdtemp(prefix="stridelab-test-"))
    folder.chmod(0o755)
    try:
        yield folder
    finally:
        for pointer in folder.rglob("postgres.json"):  # a killed service leaves the folder of its socket behind
            shutil.rmtree(json.loads(pointer.read_text(encoding="utf-8"))["socket"], ignore_errors=True)
        shutil.rmtree(folder, ignore_errors=True)


def run_with_engine(url: str, act: Callable[[AsyncEngine], Awaitable[Any]]) -> Any:
    """Run ``act`` with an engine on ``url`` in a loop of its own and return its result."""

    async def inside() -> Any:
        engine = make_engine(url)
        try:
            return await act(engine)
        finally:
            await engine.dispose()

    return asyncio.run(inside())


@dataclass(frozen=True)
class TestDatabases:
    """Databases on one server, copied from a migrated template."""

    __test__ = False
    admin: psycopg.Connection[Any]
    admin_url: str
    template: str

    @contextmanager
    def fresh(self, *, migrated: bool = True) -> Iterator[str]:
        """URL of a new database; dropped at the end even if connections are open."""
        name = f"stridelab_test_{os.getpid()}_{next(_numbers)}"
        template = self.template if migrated else "template1"
        self.admin.execute(f'CREATE DATABASE "{name}" TEMPLATE "{template}"')
        try:
            yield self._url(name)
        finally:
            self.admin.execute(f'DROP DATABASE "{name}" WITH (FORCE)')

    def empty(self, url: str) -> None:
        """Remove all rows and end all connections of a database, at less cost than making a new one.

        Rows are deleted, since TRUNCATE makes new files for every table and index.
        """
        deletions = "; ".join(f"DELETE FROM {table.name}" for table in reversed(metadata.sorted_tables))
        with psycopg.connect(url, autocommit=True) as connection:
            connection.execute(
                "SELECT pg_terminate_backend(pid, 10000) FROM pg_stat_activity"
                " WHERE datname = current_database() AND pid <> pg_backend_pid()"
            )
            connection.execute(deletions)
            connection.execute("SELECT setval(oid, 1, false) FROM pg_class WHERE relkind = 'S'")

    def _url(self, name: str) -> str:
        return parse_url(self.admin_url).set(database=name).render_as_string(hide_password=False)


@contextmanager
def _server() -> Iterator[str]:
    """URL of the server under test: STRIDELAB_TEST_DATABASE_URL (a superuser's), or an embedded one."""
    stated_url = os.environ.get("STRIDELAB_TEST_DATABASE_URL")
    if stated_url:
        yield stated_url
        return
    with public_folder() as folder:
        server = EmbeddedPostgres(folder)
        try:
            url = server.start()
            with psycopg.connect(url, autocommit=True) as admin:
                for name in ("fsync", "full_page_writes", "autovacuum"):  # nothing outlives the tests
                    admin.execute(f"ALTER SYSTEM SET {name} = off")
                admin.execute("SELECT pg_reload_conf()")
            yield url
        finally:
            server.stop()


@contextmanager
def databases() -> Iterator[TestDatabases]:
    """One server for a whole test session."""
    with _server() as url:
        template = f"stridelab_template_{os.getpid()}_{next(_numbers)}"
        with psycopg.connect(url, autocommit=True) as admin:
            test_databases = TestDatabases(admin, url, template)
            admin.execute(f'CREATE DATABASE "{template}"')
            try:
                migrate(test_databases._url(template))
                yield test_databases
            finally:
                admin.execute(f'DROP DATABASE "{template}" WITH (FORCE)')


def migrate_to(url: str, revision: str) -> None:
    """Bring an empty database to ``revision``."""
    engine = engine_of(url)
    with engine.begin() as connection:
        upgrade_on(connection, revision)
    engine.dispose()


def schema_differences(connection: sqlalchemy.Connection) -> list[Any]:
    """In what the tables differ from the declared ones."""
    context = MigrationContext.configure(connection, opts={"compare_server_default": True})
    return list(compare_metadata(context, metadata))


N_RECORDINGS: Final = 20_000
N_SUBJECTS: Final = 400
N_OF_OLDEST: Final = 130
"""Recordings of the first subject; they are the oldest."""
_SUBJECTS: Final = """
    INSERT INTO subject (id, created_at, fields)
    SELECT 's' || n, timestamptz '2026-01-01 00:00Z' + n * interval '1 minute', jsonb_build_object('name', 'P' || n)
      FROM generate_series(1, %(subjects)s) AS n
"""
_RECORDINGS: Final = """
    INSERT INTO recording
           (id, created_at, filename, sha256, bytes, blob_key, tracks_key, facts, subject_fields, subject_id)
    SELECT 'r' || n, timestamptz '2026-01-01 00:00Z' + n * interval '1 minute', n || '.c3d',
           's', 1, 'u/' || n, 't/' || n, %(facts)s, '{}',
           CASE WHEN n <= %(of_oldest)s THEN 's1' WHEN n %% 3 > 0 THEN 's' || 2 + n %% (%(subjects)s - 1) END
      FROM generate_series(1, %(recordings)s) AS n
"""

N_JOBS: Final = 10_000
N_SCENARIOS: Final = 10_000
_SCENARIOS: Final = """
    INSERT INTO scenario (id, created_at, body)
    SELECT 'c' || n, timestamptz '2026-01-01 00:00Z' + n * interval '1 minute', %(body)s
      FROM generate_series(1, %(scenarios)s) AS n
"""
_JOBS: Final = """
    INSERT INTO job (id, created_at, kind, state, attempt, input, input_hash, fraction, scenario_id, error)
    SELECT 'j' || n, timestamptz '2026-01-01 00:00Z' + n * interval '1 minute',
           (ARRAY['estimate-com', 'sweep', 'study-population', 'plan-motion'])[1 + n %% 4], 'failed', 1, '{}',
           'h' || n, 1,
           CASE WHEN n %% 4 = 3 THEN 'c' || n END,
           '{"title": "Unprocessable", "status": 422, "code": "no-window", "detail": "No interval is measured."}'
      FROM generate_series(1, %(jobs)s) AS n
"""


def store_many_jobs(url: str) -> None:
    """Fill a database with scenarios and with jobs of four kinds in turn, the last kind about a scenario each."""
    values = {"scenarios": N_SCENARIOS, "jobs": N_JOBS, "body": json.dumps(ONE_STEP)}
    with psycopg.connect(url) as connection:
        connection.execute(_SCENARIOS, values)
        connection.execute(_JOBS, values)


def store_many_recordings(url: str) -> None:
    """Fill an empty database: the first subject has the oldest recordings, a third of the others has no subject."""
    labels = [f"Marker {n}" for n in range(60)]
    of_a_walk = facts(labels=labels, landmarks={f"landmark_{n}": label for n, label in enumerate(labels)})
    values = {
        "facts": json.dumps(of_a_walk.model_dump(mode="json")),
        "subjects": N_SUBJECTS,
        "recordings": N_RECORDINGS,
        "of_oldest": N_OF_OLDEST,
    }
    with psycopg.connect(url) as connection:
        connection.execute(_SUBJECTS, values)
        connection.execute(_RECORDINGS, values)


async def remove_orphans_now(engine: AsyncEngine, blobs: Path) -> list[str]:
    """Remove what the janitor removes once everything is old."""
    async with engine.connect() as connection:
        return await remove_orphans(connection, BlobStore.from_url(blobs.as_uri()), timedelta(seconds=-1))


def socket_of(url: str) -> str:
    """Socket of an embedded server."""
    folder = parse_url(url).query.get("host")
    assert isinstance(folder, str), "the proxy leads to an embedded server's socket"
    return f"{folder}/.s.PGSQL.5432"
