"""Lists and pages of subjects at 20 000 recordings: nothing is left out, and no answer reads them all."""

import json
import re
import time
from collections.abc import Callable, Iterator
from datetime import UTC, datetime, timedelta
from typing import Any

import httpx
import psycopg
import pytest

from stridelab.service.cursors import encode_cursor
from stridelab.service.storage.migrate import plain
from support.service.database import TestDatabases
from support.service.stored_rows import facts
from support.service.web_server import Served, served

RECORDINGS, SUBJECTS, OF_OLDEST = 20_000, 400, 130
_SUBJECTS = """
    INSERT INTO subject (id, created_at, fields)
    SELECT 's' || n, timestamptz '2026-01-01 00:00Z' + n * interval '1 minute', jsonb_build_object('name', 'P' || n)
      FROM generate_series(1, %(subjects)s) AS n
"""
_RECORDINGS = """
    INSERT INTO recording
           (id, created_at, filename, sha256, bytes, blob_key, tracks_key, facts, subject_fields, subject_id)
    SELECT 'r' || n, timestamptz '2026-01-01 00:00Z' + n * interval '1 minute', n || '.c3d',
           's', 1, 'u/' || n, 't/' || n, %(facts)s, '{}',
           CASE WHEN n <= %(of_oldest)s THEN 's1' WHEN n %% 3 > 0 THEN 's' || 2 + n %% (%(subjects)s - 1) END
      FROM generate_series(1, %(recordings)s) AS n
"""


@pytest.fixture(scope="module")
def service(postgres: TestDatabases, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    """The first subject has the oldest recordings, a third of the others is nobody's."""
    labels = [f"Marker {n}" for n in range(60)]
    of_a_walk = facts(labels=labels, landmarks={f"landmark_{n}": label for n, label in enumerate(labels)})
    asked = {
        "facts": json.dumps(of_a_walk.model_dump(mode="json")),
        "subjects": SUBJECTS,
        "recordings": RECORDINGS,
        "of_oldest": OF_OLDEST,
    }
    with postgres.fresh() as url:
        with psycopg.connect(plain(url)) as connection:
            connection.execute(_SUBJECTS, asked)
            connection.execute(_RECORDINGS, asked)
        with served(url, tmp_path_factory.mktemp("data")) as running:
            yield running


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
        "/api/v1/subjects",
        "/api/v1/recordings",
        "/api/v1/recordings?subject_id=s1",
        "/api/v1/recordings?linked=false",
    ],
)
def test_no_answer_reads_all_recordings(http: httpx.Client, service: Served, path: str) -> None:
    """An answer takes less time than reading the facts of all recordings once, on whatever machine this is."""

    def fastest_s(work: Callable[[], object]) -> float:
        took_s = []
        for _ in range(8):
            began_s = time.perf_counter()
            work()
            took_s.append(time.perf_counter() - began_s)
        return min(took_s)

    url = plain(service.parts.engine.url.render_as_string(hide_password=False))
    with psycopg.connect(url) as connection:
        all_s = fastest_s(lambda: connection.execute("SELECT facts FROM recording").fetchall())
    assert http.get(path).status_code == 200
    assert fastest_s(lambda: http.get(path)) < all_s


def test_every_recording_of_every_subject_is_counted(http: httpx.Client) -> None:
    counts = {one["subject_id"]: one["n_recordings"] for one in every(http, "/api/v1/subjects")}
    assert len(counts) == SUBJECTS
    assert counts["s1"] == OF_OLDEST == http.get("/api/v1/subjects/s1").json()["n_recordings"]
    free = (RECORDINGS - OF_OLDEST) // 3
    assert abs(sum(counts.values()) - (RECORDINGS - free)) <= 1
    page = http.get("/subjects?cursor=" + http.get("/api/v1/subjects?limit=200").json()["next"]).text
    assert len(re.findall("<tr data-subject=", page)) == 50


def test_the_oldest_recordings_are_found_by_their_subject(http: httpx.Client) -> None:
    found = [one["id"] for one in every(http, "/api/v1/recordings", subject_id="s1")]
    assert found == [f"r{n}" for n in range(OF_OLDEST, 0, -1)]
    first = http.get("/subjects/s1").text
    assert re.findall(r'name="recording" value="(\w+)"', first) == found[:50]
    (older,) = re.findall(r'href="(/subjects/s1\?cursor=[^"]+)"', first)
    assert re.findall(r'name="recording" value="(\w+)"', http.get(older).text) == found[50:100]


def test_recordings_of_nobody_are_offered_to_the_last(http: httpx.Client) -> None:
    # from the oldest thousand on: every page costs time here
    cursor = encode_cursor(datetime(2026, 1, 1, tzinfo=UTC) + timedelta(minutes=1000), "r1000")
    free = [one["id"] for one in every(http, "/api/v1/recordings", cursor, linked="false")]
    assert free == [f"r{n}" for n in range(999, OF_OLDEST, -1) if n % 3 == 0]
    linked = [one["id"] for one in every(http, "/api/v1/recordings", cursor, linked="true")]
    assert sorted([*free, *linked], key=lambda each: -int(each[1:])) == [f"r{n}" for n in range(999, 0, -1)]
