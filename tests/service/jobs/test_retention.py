import asyncio
from collections.abc import Awaitable, Callable
from datetime import timedelta
from pathlib import Path
from typing import Any

import psycopg
import pytest
from sqlalchemy import text
from sqlalchemy.ext.asyncio import AsyncConnection, AsyncEngine

from stridelab.service.jobs.partial_results import delete_stale_chunks
from stridelab.service.jobs.retention import remove_expired, remove_old_events, remove_old_jobs, remove_orphans
from stridelab.service.jobs.store import JobStore
from stridelab.service.settings import Settings
from stridelab.service.storage.blobs import BlobStore
from support.service.database import run_with_engine
from support.service.job_kinds import KINDS

Act = Callable[[JobStore, AsyncConnection], Awaitable[Any]]


@pytest.fixture
def blobs(tmp_path: Path) -> BlobStore:
    return BlobStore.from_url((tmp_path / "blobs").as_uri())


@pytest.fixture
def use(database_url: str) -> Callable[[Act], Any]:
    def run(act: Act) -> Any:
        async def inside(engine: AsyncEngine) -> Any:
            async with engine.connect() as connection:
                return await act(JobStore(engine, KINDS), connection)

        return run_with_engine(database_url, inside)

    return run


def age(url: str, job_id: str, state: str, days: float) -> None:
    """Let a job have ended ``days`` ago."""
    with psycopg.connect(url) as connection:
        connection.execute(
            "UPDATE job SET state = %s, finished_at = now() - make_interval(secs => %s) WHERE id = %s",
            (state, days * 86400, job_id),
        )


def test_parts_of_attempts_that_do_not_run_go(use: Any, database_url: str) -> None:
    """Parts go with their attempt; the janitor removes those that a lost transaction has left."""
    body = '{"kind": "certificate", "checks": [], "passed": true}'

    async def act(store: JobStore, connection: AsyncConnection) -> None:
        runs, ended = [(await store.submit("work", {"n": n})).job_id for n in range(2)]

        def leave() -> None:
            with psycopg.connect(database_url) as other:
                for job_id, state, attempt in ((runs, "running", 2), (ended, "failed", 1)):
                    values = [state, attempt, job_id]
                    other.execute("UPDATE job SET state = %s, attempt = %s WHERE id = %s", values)
                for job_id, attempt in ((runs, 1), (runs, 2), (ended, 1)):
                    other.execute("INSERT INTO job_partial VALUES (%s, %s, 1, %s)", [job_id, attempt, body])

        await asyncio.to_thread(leave)
        await delete_stale_chunks(connection)
        rows = (await connection.execute(text("SELECT job_id, attempt FROM job_partial"))).all()
        assert [tuple(row) for row in rows] == [(runs, 2)]

    use(act)


def test_old_jobs_go_with_their_files(use: Any, blobs: BlobStore, database_url: str, tmp_path: Path) -> None:
    (tmp_path / "x").write_bytes(b"x")

    async def act(store: JobStore, connection: AsyncConnection) -> None:
        old, fresh, waiting = [(await store.submit("work", {"n": n})).job_id for n in range(3)]
        for job_id in (old, fresh, waiting):
            await blobs.put_file(f"results/{job_id}/1/x", tmp_path / "x")
        await asyncio.to_thread(age, database_url, old, "succeeded", 91)
        await asyncio.to_thread(age, database_url, fresh, "failed", 89)
        assert await remove_old_jobs(connection, blobs, timedelta(days=90)) == [old]
        assert {record.id for record in (await store.list_jobs()).items} == {fresh, waiting}
        assert [info.key async for info in blobs.list_prefix(f"results/{old}")] == []
        assert await blobs.exists(f"results/{fresh}/1/x")

    use(act)


def test_ground_truth_stays_with_its_recording(use: Any, blobs: BlobStore, database_url: str) -> None:
    async def act(store: JobStore, connection: AsyncConnection) -> None:
        truth = (await store.submit("work", {})).job_id
        await asyncio.to_thread(age, database_url, truth, "succeeded", 1000)

        def refer() -> None:
            with psycopg.connect(database_url) as other:
                other.execute(
                    "INSERT INTO recording (id, filename, sha256, bytes, blob_key, tracks_key, facts, subject_fields,"
                    " truth_job_id) VALUES ('r', 'f', 's', 1, 'a', 'b', '{}', '{}', %s)",
                    (truth,),
                )

        await asyncio.to_thread(refer)
        assert await remove_old_jobs(connection, blobs, timedelta(days=90)) == []
        assert (await store.get(truth)).state == "succeeded"

    use(act)


def test_old_events_go_and_those_of_open_jobs_stay(use: Any, database_url: str) -> None:
    async def act(store: JobStore, connection: AsyncConnection) -> None:
        old, waiting = [(await store.submit("work", {"n": n})).job_id for n in range(2)]
        await asyncio.to_thread(age, database_url, old, "succeeded", 8)
        await remove_old_events(connection, timedelta(days=7))
        assert await store.events_after(old) == ()
        assert len(await store.events_after(waiting)) == 1
        assert (await store.get(old)).state == "succeeded"

    use(act)


def test_only_files_without_a_row_are_orphans(use: Any, blobs: BlobStore, database_url: str, tmp_path: Path) -> None:
    (tmp_path / "x").write_bytes(b"x")

    async def act(store: JobStore, connection: AsyncConnection) -> None:
        finished, running = [(await store.submit("work", {"n": n})).job_id for n in range(2)]

        def arrange() -> None:
            with psycopg.connect(database_url) as other:
                other.execute(
                    "UPDATE job SET state = 'succeeded', attempt = 2, blob_prefix = %s WHERE id = %s",
                    (f"results/{finished}/2", finished),
                )
                other.execute("UPDATE job SET state = 'running', attempt = 3 WHERE id = %s", (running,))
                other.execute(
                    "INSERT INTO recording (id, filename, sha256, bytes, blob_key, tracks_key, facts, subject_fields)"
                    " VALUES ('kept', 'f', 's', 1, 'recordings/kept/a', 'recordings/kept/b', '{}', '{}')"
                )

        await asyncio.to_thread(arrange)
        keys = [
            f"results/{finished}/1/x",
            f"results/{finished}/2/x",
            f"results/{running}/2/x",
            f"results/{running}/3/x",
            "results/gone/1/x",
            "recordings/kept/a",
            "recordings/kept/b",
            "recordings/kept/tracks-of-other-switches",
            "recordings/lost/a",
        ]
        for key in keys:
            await blobs.put_file(key, tmp_path / "x")
        assert await remove_orphans(connection, blobs) == []  # all too young to be called orphans
        removed = await remove_orphans(connection, blobs, timedelta(seconds=-1))
        assert set(removed) == {
            f"results/{finished}/1",
            f"results/{running}/2",
            "results/gone/1",
            "recordings/kept/tracks-of-other-switches",
            "recordings/lost/a",
        }
        for key in keys:
            expected = key not in removed and key.rsplit("/", 1)[0] not in removed
            assert await blobs.exists(key) is expected

    use(act)


def test_workers_that_died_are_forgotten_after_a_day(database_url: str, blobs: BlobStore) -> None:
    with psycopg.connect(database_url) as connection:
        connection.execute(
            "INSERT INTO worker (last_heartbeat) VALUES (now() - interval '23 h'), (now() - interval '25 h')"
        )
    run_with_engine(database_url, lambda engine: remove_expired(engine, blobs, Settings(database_url=database_url)))
    with psycopg.connect(database_url) as connection:
        remaining = connection.execute("SELECT now() - last_heartbeat < interval '24 h' FROM worker")
        assert remaining.fetchall() == [(True,)]
