"""One running application for the tests of the interface; each module gets its own database and files."""

from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest

from support.recordings.c3d_files import small_trial
from support.service.database import TestDatabases
from support.service.web_server import Served, served


@pytest.fixture(scope="module")
def service(postgres: TestDatabases, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    with postgres.fresh() as url, served(url, tmp_path_factory.mktemp("data")) as running:
        yield running


@pytest.fixture
def http(service: Served) -> Iterator[httpx.Client]:
    with service.http() as client:
        yield client


@pytest.fixture(scope="session")
def trial(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return small_trial(tmp_path_factory.mktemp("trials") / "walk.c3d")


@pytest.fixture
def anyio_backend() -> str:
    return "asyncio"
