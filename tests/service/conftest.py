"""One PostgreSQL for all service tests; every test gets a database of its own."""

from collections.abc import Iterator

import pytest

from support.database import TestDatabases, databases


@pytest.fixture(scope="session")
def postgres() -> Iterator[TestDatabases]:
    with databases() as made:
        yield made


@pytest.fixture
def database_url(postgres: TestDatabases) -> Iterator[str]:
    with postgres.fresh() as url:
        yield url
