"""The connection to the database breaks at the COMMIT of an upload or a change: the answer is true, no file is lost."""

import re
import time
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import timedelta
from pathlib import Path

import httpx
import psycopg
import pytest

from stridelab.service.api.recordings import service
from stridelab.service.jobs import retention
from stridelab.service.settings import Settings
from stridelab.service.storage.database import parse_url
from support.faults.commits import FAULTS, CommitProxy, Fault, Plan, commit_proxy
from support.service.database import TestDatabases
from support.service.web_server import Served, refusal_code, served, upload

RECORDINGS = "/api/v1/recordings"
INSERTED, CHANGED = re.compile("INSERT INTO recording "), re.compile("UPDATE recording SET ")


def answered(http: httpx.Client, path: str) -> int:
    """The status of ``path`` once the database can be reached again."""
    until = time.monotonic() + 10.0
    while (status := http.get(path).status_code) == 503 and time.monotonic() < until:
        time.sleep(0.2)
    return status


@contextmanager
def behind(url: str, data: Path, plan: Plan) -> Iterator[tuple[Served, CommitProxy]]:
    """The application, with the proxy between it and its database."""
    address = parse_url(url)
    folder = address.query.get("host")
    assert isinstance(folder, str)
    with commit_proxy(f"{folder}/.s.PGSQL.5432", plan) as proxy:
        through = f"postgresql://{address.username}@127.0.0.1:{proxy.port}/{address.database}?sslmode=disable"
        with served(through, data) as running:
            yield running, proxy


@pytest.fixture
def url(postgres: TestDatabases) -> Iterator[str]:
    with postgres.fresh() as fresh_url:
        yield fresh_url


def sweep(lab: Served, url: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """What a worker's janitor does an hour later."""
    monkeypatch.setattr(retention.remove_orphans, "__defaults__", (timedelta(seconds=-1),))
    monkeypatch.setattr(retention, "ORPHAN_AGE", timedelta(seconds=-1))

    lab.run(retention.remove_expired(lab.parts.engine, lab.parts.blobs, Settings(database_url=url)))


def assert_whole(http: httpx.Client, url: str, lab: Served) -> list[str]:
    """Every listed recording has its files, and there are no others; returns the ids."""
    listed = [str(one["id"]) for one in http.get(RECORDINGS).json()["items"]]
    for one in listed:
        assert http.get(f"{RECORDINGS}/{one}/file").status_code == 200
        assert http.get(f"{RECORDINGS}/{one}/tracks.parquet").status_code == 200
    with psycopg.connect(url) as connection:
        rows = connection.execute("SELECT blob_key, tracks_key FROM recording").fetchall()
    assert lab.stored_files() == {key for row in rows for key in row}
    return listed


@pytest.mark.parametrize("fault", FAULTS)
def test_answer_to_an_upload_is_true_whatever_becomes_of_its_commit(
    fault: Fault, url: str, tmp_path: Path, trial: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plan = Plan(lambda text: INSERTED.search(text) is not None, fault, delay_s=1.5)
    with behind(url, tmp_path / "data", plan) as (lab, proxy), lab.http() as http:
        answer = upload(http, trial.read_bytes())
        assert proxy.struck.is_set()
        if fault == "lost request":
            assert refusal_code(answer) == (503, "database-unreachable")
            assert assert_whole(http, url, lab) == []
        else:
            assert answer.status_code == 201
            assert assert_whole(http, url, lab) == [answer.json()["id"]]
        sweep(lab, url, monkeypatch)
        assert len(assert_whole(http, url, lab)) == (0 if fault == "lost request" else 1)


def test_upload_whose_outcome_stays_unknown_is_refused_and_keeps_its_files(
    url: str, tmp_path: Path, trial: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(service, "_COMMIT_WAIT_S", 0.0)

    async def never(*_: object) -> bool:
        return False  # as long as the server has not noticed that the connection is gone

    monkeypatch.setattr(service, "try_lock_blob", never)
    plan = Plan(lambda text: INSERTED.search(text) is not None, "lost answer")
    with behind(url, tmp_path / "data", plan) as (lab, _), lab.http() as http:
        assert refusal_code(upload(http, trial.read_bytes())) == (503, "outcome-unknown")
        assert len(assert_whole(http, url, lab)) == 1


@pytest.mark.parametrize("fault", FAULTS)
def test_tracks_survive_whatever_becomes_of_the_commit_of_a_change(
    fault: Fault, url: str, tmp_path: Path, trial: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plan = Plan(lambda text: CHANGED.search(text) is not None, fault, delay_s=1.5)
    with behind(url, tmp_path / "data", plan) as (lab, proxy), lab.http() as http:
        recording = upload(http, trial.read_bytes()).json()["id"]
        answer = http.patch(f"{RECORDINGS}/{recording}", json={"plates": {"1": {"use": False}}})
        assert proxy.struck.is_set()
        assert answer.status_code == (200 if fault.startswith("late") else 503)
        assert answered(http, f"{RECORDINGS}/{recording}/tracks.parquet") == 200
        sweep(lab, url, monkeypatch)
        assert assert_whole(http, url, lab) == [recording]


def test_janitor_leaves_files_of_an_upload_that_has_yet_to_commit(
    url: str, tmp_path: Path, trial: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The COMMIT comes late, after the janitor has called its files old."""
    swept: list[set[str]] = []

    def hour_later() -> None:
        sweep(lab, url, monkeypatch)
        swept.append(lab.stored_files())

    plan = Plan(lambda text: INSERTED.search(text) is not None, "late request", delay_s=0.0, at_fault=hour_later)
    with behind(url, tmp_path / "data", plan) as (lab, _), lab.http() as http:
        monkeypatch.setattr("stridelab.service.storage.content_addressed.delete_if_unused", _refuse_to_wait)
        assert upload(http, trial.read_bytes()).status_code == 201
        assert swept
        assert len(assert_whole(http, url, lab)) == 1


async def _refuse_to_wait(*_: object) -> bool:
    """The real one waits for the upload to end, which waits for the janitor here."""
    return False
