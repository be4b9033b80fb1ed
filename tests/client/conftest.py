"""A running application for the client to talk to."""

from collections.abc import Iterator

import pytest

from stridelab.client import Client
from support.service.database import TestDatabases
from support.service.web_server import Served, served


@pytest.fixture(scope="session")
def service(postgres: TestDatabases, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    with postgres.fresh() as url, served(url, tmp_path_factory.mktemp("data")) as running:
        yield running


@pytest.fixture
def lab(service: Served) -> Iterator[Client]:
    with Client(service.base_url) as client:
        yield client


@pytest.fixture
def anyio_backend() -> str:
    return "asyncio"
