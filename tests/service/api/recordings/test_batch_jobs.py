"""Bulk uploads that are too large, or take too long, to be read before they are answered."""

import asyncio
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import timedelta
from pathlib import Path
from typing import Any

import httpx
import psycopg
import pytest

from stridelab.client import Client, ProblemError
from stridelab.service.api.recordings import batch
from stridelab.service.backup.archive import open_archive
from stridelab.service.backup.create import create_backup
from stridelab.service.jobs import retention
from stridelab.service.jobs.worker import Worker
from stridelab.service.kinds.registry import KINDS, PARSE_BATCH
from stridelab.service.storage.migrate import libpq_address
from support.service.web_server import Served

BATCH = "/api/v1/recordings/batch"
TABLE = "file,subject,group,height_m,static\nwalk 0.c3d,P01,adults,1.80,standing.c3d\nwalk 1.c3d,P02,,1.31,\n"


@contextmanager
def working(service: Served) -> Iterator[None]:
    """A worker for the real kinds on the service's database."""
    settings = service.parts.settings.model_copy(update={"heartbeat_s": 0.4, "stall_s": 60.0})
    workers: list[Worker] = []
    started = threading.Event()

    async def work() -> None:
        workers.append(Worker(str(settings.database_url), service.parts.blobs, KINDS, settings))
        started.set()
        await workers[0].run()

    loop = asyncio.new_event_loop()
    thread = threading.Thread(target=loop.run_until_complete, args=(work(),), daemon=True)
    thread.start()
    assert started.wait(30)
    try:
        yield
    finally:
        loop.call_soon_threadsafe(workers[0].stop)
        thread.join(30)
        assert not thread.is_alive()
        loop.close()


@pytest.fixture
def files(trial: Path) -> list[tuple[str, bytes]]:
    """Two walks and a standing trial with different bytes, and a file that is no recording."""
    content = trial.read_bytes()
    names = ("walk 0.c3d", "walk 1.c3d", "standing.c3d")
    return [(name, content + bytes([n]) * 512) for n, name in enumerate(names)] + [("broken.c3d", b"no c3d")]


@pytest.fixture
def all_are_large(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(batch, "MAX_DIRECT_FILES", 0)


def send(http: httpx.Client, files: list[tuple[str, bytes]], table: str | None = TABLE) -> httpx.Response:
    parts = [("file", one) for one in files]
    return http.post(BATCH, files=parts, data={} if table is None else {"subjects": table}, timeout=60.0)


def waited_for(http: httpx.Client, answer: httpx.Response) -> dict[str, Any]:
    assert answer.status_code == 202, answer.text
    assert answer.headers["location"] == f"/api/v1/jobs/{answer.json()['id']}"
    deadline = time.monotonic() + 120.0
    while time.monotonic() < deadline:
        job = http.get(answer.headers["location"], params={"wait": 20}).json()
        if job["finished_at"]:
            return dict(job)
    raise AssertionError(job)


def batches(service: Served) -> set[str]:
    return {key for key in service.stored_files() if key.startswith(("batches/", "spool/"))}


@pytest.mark.usefixtures("all_are_large")
def test_a_large_upload_is_read_by_a_job(service: Served, http: httpx.Client, files: list[tuple[str, bytes]]) -> None:
    began_s = time.monotonic()
    answer = send(http, files)
    assert time.monotonic() - began_s < 30.0
    assert len(batches(service)) == len(files) + 2  # the table, and what is to be done
    with psycopg.connect(libpq_address(str(service.parts.settings.database_url))) as connection:
        row = connection.execute("SELECT input::text FROM job WHERE id = %s", (answer.json()["id"],)).fetchone()
    assert row is not None
    (job_input,) = row
    assert "walk" not in job_input
    with working(service):
        job = waited_for(http, answer)
    assert (job["state"], job["kind"]) == ("succeeded", "read-batch"), job
    summary = http.get(f"/api/v1/jobs/{job['id']}/result").json()["summary"]
    walk, other, standing = (http.get(f"/api/v1/recordings/{one}").json() for one in summary["recording_ids"])
    assert [one["filename"] for one in (walk, other, standing)] == ["walk 0.c3d", "walk 1.c3d", "standing.c3d"]
    assert walk["static_recording_id"] == standing["id"]
    assert walk["session_id"]
    assert (walk["subject"]["name"], other["subject"]["height_m"]) == ("P01", 1.31)
    assert summary["studied"] == [walk["id"], other["id"]]
    assert [(row["recording_id"], row["group"]) for row in summary["subjects"]] == [
        (walk["id"], "adults"),
        (other["id"], None),
    ]
    assert [one["filename"] for one in summary["refused"]] == ["broken.c3d"]
    assert http.get(f"/api/v1/recordings/{other['id']}/file").content == files[1][1]
    assert http.get(f"/api/v1/recordings/{other['id']}/tracks.parquet").content[:4] == b"PAR1"
    assert batches(service) == set()
    page = http.get(f"/jobs/{job['id']}")
    assert page.status_code == 200
    assert "Bulk upload" in page.text
    # the job holds the names of people and files: it is named, or goes, with a recording that is deleted
    deletion = http.delete(f"/api/v1/recordings/{walk['id']}")
    assert deletion.headers["stridelab-kept-in"] == job["id"]
    assert "stridelab-kept-in" not in http.delete(f"/api/v1/recordings/{other['id']}?with_studies=true").headers
    assert http.get(f"/api/v1/jobs/{job['id']}").status_code == 404


def test_an_upload_that_takes_long_goes_on_as_a_job(
    service: Served, http: httpx.Client, files: list[tuple[str, bytes]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whether it waits for a slot or is being read: the answer comes in time, and nothing is stored twice."""
    settings = service.parts.settings.model_copy(update={"batch_answer_s": 1.0})
    parts = service.parts.__class__(**{**vars(service.parts), "settings": settings})
    monkeypatch.setitem(service.app.state._state, "parts", parts)
    run = parts.pool.run

    async def slowly(target: str, *arguments: Any, **options: Any) -> Any:
        if target == PARSE_BATCH:
            await asyncio.sleep(3600.0)
        return await run(target, *arguments, **options)

    monkeypatch.setattr(parts.pool, "run", slowly)
    before = len(http.get("/api/v1/recordings?limit=200").json()["items"])
    began_s = time.monotonic()
    answers = [send(http, files[:1], None)]

    async def take_all_slots() -> None:
        for holder in range(int(parts.batches.total_tokens)):
            await parts.batches.acquire_on_behalf_of(holder)

    async def give_them_back() -> None:
        for holder in range(int(parts.batches.total_tokens)):
            parts.batches.release_on_behalf_of(holder)

    service.run(take_all_slots())
    answers.append(send(http, files[1:2], None))
    service.run(give_them_back())
    assert time.monotonic() - began_s < 20.0
    with working(service):
        states = [waited_for(http, answer)["state"] for answer in answers]
    assert states == ["succeeded", "succeeded"]
    assert len(http.get("/api/v1/recordings?limit=200").json()["items"]) == before + 2


def test_a_small_upload_is_answered_as_before(
    service: Served, http: httpx.Client, files: list[tuple[str, bytes]]
) -> None:
    answer = send(http, files)
    assert answer.status_code == 201, answer.text
    assert [one["filename"] for one in answer.json()["recordings"]] == ["walk 0.c3d", "walk 1.c3d", "standing.c3d"]
    many = send(http, [(f"{n}.c3d", b"x") for n in range(21)], None)
    assert many.status_code == 202
    assert http.delete(many.headers["location"]).json()["state"] == "cancelled"


@pytest.mark.usefixtures("all_are_large")
def test_a_client_waits_for_the_job(service: Served, files: list[tuple[str, bytes]], tmp_path: Path) -> None:
    paths = []
    for name, content in files:
        paths.append((name, tmp_path / name))
        paths[-1][1].write_bytes(content)
    with working(service), Client(service.base_url) as client:
        stored = client.upload_batch(paths, TABLE)
        assert [one.filename for one in stored.recordings] == ["walk 0.c3d", "walk 1.c3d", "standing.c3d"]
        assert stored.studied == [one.id for one in stored.recordings[:2]]
        with pytest.raises(ProblemError) as unreadable:
            client.upload_batch(paths[3:])
        with pytest.raises(ProblemError) as unmatched:
            client.upload_batch(paths[:1], TABLE)
    assert unreadable.value.problem.code == "nothing-readable"
    assert unmatched.value.problem.code == "subject-table-invalid"
    assert batches(service) == set()


@pytest.mark.usefixtures("all_are_large")
def test_files_of_a_refused_or_cancelled_job_go_and_those_of_a_waiting_one_stay(
    service: Served, http: httpx.Client, files: list[tuple[str, bytes]], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    limit = service.parts.store._queue_limit
    monkeypatch.setattr(service.parts.store, "_queue_limit", 0)
    refused = send(http, files)
    assert (refused.status_code, refused.json()["code"]) == (429, "queue-full")
    assert batches(service) == set()
    monkeypatch.setattr(service.parts.store, "_queue_limit", limit)

    waiting, cancelled = send(http, files[:1], None).json()["id"], send(http, files[:2], None).json()["id"]
    assert len(batches(service)) == 5
    http.delete(f"/api/v1/jobs/{cancelled}")
    assert len(batches(service)) == 2
    (tmp_path / "x").write_bytes(b"of a web server that was killed before it submitted the job")
    service.run(service.parts.blobs.put_file(f"batches/{'0' * 32}/upload-0000", tmp_path / "x"))

    async def sweep() -> None:
        async with service.parts.engine.connect() as connection:
            await retention.remove_orphans(connection, service.parts.blobs, timedelta(0))

    service.run(sweep())
    assert len(batches(service)) == 2
    create_backup(str(service.parts.settings.database_url), service.parts.blobs, tmp_path / "lab.backup")
    with open_archive(tmp_path / "lab.backup") as archive:
        assert {key for key in archive.manifest.file_keys if key.startswith("batches/")} == batches(service)
    http.delete(f"/api/v1/jobs/{waiting}")
    assert batches(service) == set()


def test_the_job_kind_cannot_be_submitted_over_http(http: httpx.Client) -> None:
    job_input = {"batch_id": "0" * 32, "files": []}
    answer = http.post("/api/v1/jobs/read-batch", json=job_input)
    assert (answer.status_code, answer.json()["code"]) == (404, "unknown-job-kind")
    assert "read-batch" not in answer.json()["detail"]
