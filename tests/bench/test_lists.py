"""Lists and pages at 20 000 recordings; run by ``make bench``. The bar: an answer within 100 ms."""

from collections.abc import Iterator
from typing import Any

import httpx
import pytest

from stridelab.service.storage.migrate import libpq_address
from support.service.database import N_RECORDINGS, TestDatabases, store_many_recordings
from support.service.web_server import served


@pytest.fixture(scope="module")
def http(postgres: TestDatabases, tmp_path_factory: pytest.TempPathFactory) -> Iterator[httpx.Client]:
    with postgres.fresh() as url:
        store_many_recordings(libpq_address(url))
        with served(url, tmp_path_factory.mktemp("data")) as running, running.http() as client:
            yield client


@pytest.mark.benchmark(group="service", min_rounds=30)
@pytest.mark.parametrize(
    "path", ["/subjects", "/subjects/s1", "/recordings", "/api/v1/subjects", "/api/v1/recordings?subject_id=s1"]
)
def test_list(benchmark: Any, http: httpx.Client, path: str) -> None:
    answer = benchmark(http.get, path)
    assert answer.status_code == 200
    benchmark.extra_info["recordings"] = N_RECORDINGS
    benchmark.extra_info["kB"] = round(len(answer.content) / 1e3)
