"""Lists at 20 000 recordings, 10 000 jobs and 10 000 scenarios: nothing is left out, and no answer reads them all."""

import re
import time
from collections.abc import Callable, Iterator
from datetime import UTC, datetime, timedelta
from typing import Any

import httpx
import psycopg
import pytest

from stridelab.service.cursors import encode_cursor
from stridelab.service.storage.migrate import libpq_address
from support.service.database import (
    N_JOBS,
    N_OF_OLDEST,
    N_RECORDINGS,
    N_SCENARIOS,
    N_SUBJECTS,
    TestDatabases,
    store_many_jobs,
    store_many_recordings,
)
from support.service.web_server import Served, served


@pytest.fixture(scope="module")
def service(postgres: TestDatabases, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    with postgres.fresh() as url:
        store_many_recordings(libpq_address(url))
        store_many_jobs(libpq_address(url))
        with served(url, tmp_path_factory.mktemp("data")) as running:
            yield running


def fastest_s(work: Callable[[], object], rounds: int) -> float:
    took_s = []
    for _ in range(rounds):
        began_s = time.perf_counter()
        work()
        took_s.append(time.perf_counter() - began_s)
    return min(took_s)


@pytest.fixture(scope="module")
def read_all_s(service: Served) -> float:
    url = libpq_address(service.parts.engine.url.render_as_string(hide_password=False))
    with psycopg.connect(url) as connection:
        return fastest_s(lambda: connection.execute("SELECT facts FROM recording").fetchall(), rounds=3)


def every(http: httpx.Client, path: str, cursor: str | None = None, **query: Any) -> Iterator[dict[str, Any]]:
    """All items of a list, page by page."""
    while True:
        page = http.get(path, params={"limit": 200, **query, **({"cursor": cursor} if cursor else {})}).json()
        yield from page["items"]
        cursor = page["next"]
        if cursor is None:
            return


@pytest.mark.parametrize(
    "path",
    [
        "/subjects",
        "/subjects/s1",
        "/",
        "/recordings",
        "/jobs",
        "/jobs?search=step",
        "/scenarios",
        "/sweeps",
        "/population",
        "/api/v1/subjects",
        "/api/v1/recordings",
        "/api/v1/recordings?subject_id=s1",
        "/api/v1/recordings?linked=false",
    ],
)
def test_no_request_reads_all_recordings(http: httpx.Client, read_all_s: float, path: str) -> None:
    """An answer takes less time than reading the facts of all recordings once, on whatever machine this is."""
    assert http.get(path).status_code == 200
    assert fastest_s(lambda: http.get(path), rounds=8) < read_all_s


def test_every_job_and_every_scenario_is_on_one_page(http: httpx.Client) -> None:
    own = {one["id"] for one in every(http, "/api/v1/scenarios") if not one["bundled"]}
    assert own == {f"c{n}" for n in range(1, N_SCENARIOS + 1)}
    assert [one["id"] for one in every(http, "/api/v1/jobs")] == [f"j{n}" for n in range(N_JOBS, 0, -1)]
    for path, rows, older in (
        ("/jobs", r"<tr data-job=", "Older jobs"),
        ("/scenarios", r'href="/scenarios/c\d+"', "Older scenarios"),
        ("/sweeps", r"<tr data-job=", "Older sweeps"),
        ("/population", r"<tr data-job=", "All studies"),
    ):
        page = http.get(path).text
        assert 0 < len(re.findall(rows, page)) <= 100, path
        assert older in page, path


def test_every_recording_of_every_subject_is_counted(http: httpx.Client) -> None:
    counts = {one["subject_id"]: one["n_recordings"] for one in every(http, "/api/v1/subjects")}
    assert len(counts) == N_SUBJECTS
    assert counts["s1"] == N_OF_OLDEST == http.get("/api/v1/subjects/s1").json()["n_recordings"]
    free = (N_RECORDINGS - N_OF_OLDEST) // 3
    assert abs(sum(counts.values()) - (N_RECORDINGS - free)) <= 1
    page = http.get("/subjects?cursor=" + http.get("/api/v1/subjects?limit=200").json()["next"]).text
    assert len(re.findall("<tr data-subject=", page)) == 50


def test_the_oldest_recordings_are_found_by_their_subject(http: httpx.Client) -> None:
    ids = [one["id"] for one in every(http, "/api/v1/recordings", subject_id="s1")]
    assert ids == [f"r{n}" for n in range(N_OF_OLDEST, 0, -1)]
    first = http.get("/subjects/s1").text
    assert re.findall(r'name="recording" value="(\w+)"', first) == ids[:50]
    (older,) = re.findall(r'href="(/subjects/s1\?cursor=[^"]+)"', first)
    assert re.findall(r'name="recording" value="(\w+)"', http.get(older).text) == ids[50:100]


def test_recordings_without_a_subject_are_all_offered(http: httpx.Client) -> None:
    # from the oldest thousand on: every page costs time here
    cursor = encode_cursor(datetime(2026, 1, 1, tzinfo=UTC) + timedelta(minutes=1000), "r1000")
    free = [one["id"] for one in every(http, "/api/v1/recordings", cursor, linked="false")]
    assert free == [f"r{n}" for n in range(999, N_OF_OLDEST, -1) if n % 3 == 0]
    linked = [one["id"] for one in every(http, "/api/v1/recordings", cursor, linked="true")]
    assert sorted([*free, *linked], key=lambda each: -int(each[1:])) == [f"r{n}" for n in range(999, 0, -1)]
