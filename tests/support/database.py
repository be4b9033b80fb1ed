"""A private PostgreSQL for tests, and a migrated database of its own for each test that asks."""

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import count
from pathlib import Path

import psycopg

from stridelab.service.embedded_postgres import EmbeddedPostgres
from stridelab.service.storage.database import migrate

_numbers = count()


@contextmanager
def public_folder() -> Iterator[Path]:
    """A folder that an unprivileged account can reach, so that root's server lies in it; removed at the end."""
    folder = Path(tempfile.mkdtemp(prefix="stridelab-test-"))
    folder.chmod(0o755)
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


@dataclass(frozen=True)
class TestDatabases:
    """Databases on one server, copied from a migrated template."""

    __test__ = False
    server: EmbeddedPostgres

    @property
    def admin_url(self) -> str:
        return self.server.url

    @contextmanager
    def fresh(self, *, migrated: bool = True) -> Iterator[str]:
        """URL of a new database; dropped at the end, whoever still holds a connection."""
        name = f"test_{os.getpid()}_{next(_numbers)}"
        template = "template_stridelab" if migrated else "template1"
        with psycopg.connect(self.admin_url, autocommit=True) as admin:
            admin.execute(f'CREATE DATABASE "{name}" TEMPLATE "{template}"')
        try:
            yield self._url(name)
        finally:
            with psycopg.connect(self.admin_url, autocommit=True) as admin:
                admin.execute(f'DROP DATABASE "{name}" WITH (FORCE)')

    def _url(self, name: str) -> str:
        return self.admin_url.replace("/postgres?", f"/{name}?")


@contextmanager
def databases() -> Iterator[TestDatabases]:
    """One server for a whole test session."""
    with public_folder() as folder:
        server = EmbeddedPostgres(folder)
        server.start()
        try:
            made = TestDatabases(server)
            with psycopg.connect(server.url, autocommit=True) as admin:
                admin.execute("CREATE DATABASE template_stridelab")
            migrate(made._url("template_stridelab"))
            yield made
        finally:
            server.stop()
