import asyncio
import os
import time
from collections.abc import AsyncIterator, Callable, Coroutine
from contextlib import asynccontextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import psutil
import psycopg
import pytest
import structlog

from stridelab.errors import Conflict
from stridelab.schemas.previews import PartialMotion, PartialResults
from stridelab.service.api.jobs.presentation import job_of
from stridelab.service.jobs.attempts import AttemptStore
from stridelab.service.jobs.notifications import JobNotifications
from stridelab.service.jobs.queue import attempt_prefix
from stridelab.service.jobs.store import JobRecord, JobStore
from stridelab.service.jobs.worker import Worker
from stridelab.service.settings import Settings
from stridelab.service.storage.blobs import BlobStore
from stridelab.service.storage.database import make_engine
from support.service.job_kinds import KINDS


@dataclass(frozen=True)
class Shop:
    """A store, a board and a working worker."""

    store: JobStore
    board: JobNotifications
    blobs: BlobStore
    worker: Worker

    async def do(self, kind: str, timeout_s: float = 20.0, **task: Any) -> JobRecord:
        submitted = await self.store.submit(kind, task)
        return await self.ended(submitted.job_id, timeout_s)

    async def ended(self, job_id: str, timeout_s: float = 20.0) -> JobRecord:
        record = await self.board.wait_for_end(self.store, job_id, timeout_s)
        assert record.is_final, f"still {record.state} after {timeout_s} s"
        return record

    async def running(self, job_id: str) -> JobRecord:
        with self.board.watch_job(job_id) as change:
            while True:
                change.clear()
                record = await self.store.get(job_id)
                if record.state == "running":
                    return record
                await asyncio.wait_for(change.wait(), 10.0)


Open = Callable[[Callable[[Shop], Coroutine[Any, Any, None]]], None]


@pytest.fixture
def in_shop(database_url: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Open:
    """Run an asynchronous function beside a worker with one general slot and the reserved one."""
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parents[2]))
    blobs = BlobStore.from_url((tmp_path / "blobs").as_uri())
    limits = Settings(data_dir=tmp_path, worker_slots=1, heartbeat_s=1.0, stall_s=30.0)

    @asynccontextmanager
    async def opened() -> AsyncIterator[Shop]:
        engine = make_engine(database_url)
        worker = Worker(database_url, blobs, KINDS, limits)
        working = asyncio.create_task(worker.run())
        try:
            async with JobNotifications(database_url) as board:
                yield Shop(JobStore(engine, KINDS), board, blobs, worker)
        finally:
            worker.stop()
            await working
            await engine.dispose()

    def run(act: Callable[[Shop], Coroutine[Any, Any, None]]) -> None:
        async def inside() -> None:
            async with opened() as shop:
                await act(shop)

        asyncio.run(inside())

    return run


def test_a_job_succeeds_with_files_and_provenance(in_shop: Open) -> None:
    async def act(shop: Shop) -> None:
        record = await shop.do("work", work_s=0.3)
        assert (record.state, record.attempt, record.fraction) == ("succeeded", 1, 1.0)
        assert record.started_at is not None
        assert record.finished_at is not None
        assert record.created_at <= record.started_at <= record.finished_at
        result = await shop.store.result(record.id)
        assert result.summary == {"answer": 42}
        assert result.versions["stridelab"]
        assert [(a.name, a.media_type, a.bytes) for a in result.artifacts] == [("numbers.csv", "text/csv", 11)]
        assert record.blob_prefix == attempt_prefix(record.id, 1, record.started_at)
        assert b"".join([c async for c in shop.blobs.stream(f"{record.blob_prefix}/numbers.csv")]) == b"time_s\n0.0\n"
        events = await shop.store.events_after(record.id)
        assert [event.seq for event in events] == sorted(event.seq for event in events)
        assert [event.state for event in events][:2] == ["queued", "running"]
        assert [event.state for event in events][-1] == "succeeded"
        fractions = [event.progress.fraction for event in events]
        assert fractions == sorted(fractions)
        assert len(fractions) >= 4

    in_shop(act)


def test_the_end_of_a_job_waits_for_the_progress_that_is_being_written(
    in_shop: Open, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A statement that is cancelled costs its connection to the database."""
    began, ended = [], []
    write = AttemptStore.report_progress

    async def write_slowly(*arguments: Any) -> bool:
        began.append(arguments)
        await asyncio.sleep(0.5)
        goes_on = await write(*arguments)
        ended.append(arguments)
        return goes_on

    async def act(shop: Shop) -> None:
        record = await shop.do("work", work_s=0.3)
        assert record.state == "succeeded"

    monkeypatch.setattr(AttemptStore, "report_progress", write_slowly)
    in_shop(act)
    assert began
    assert ended == began


def test_a_job_that_stops_half_way_fails_and_stores_its_partial_result(in_shop: Open) -> None:
    async def act(shop: Shop) -> None:
        record = await shop.do("stop-half-way")
        assert record.state == "failed"
        assert record.error == {
            "code": "stopped",
            "detail": "It cannot go on.",
            "errors": [{"where": "phases[1]", "message": "at 0.0 s"}],
        }
        assert job_of(record).has_result
        result = await shop.store.result(record.id)
        assert result.summary == {"until_s": 0.5}
        assert [(a.name, a.bytes) for a in result.artifacts] == [("half.csv", 11)]
        assert b"".join([c async for c in shop.blobs.stream(f"{record.blob_prefix}/half.csv")]) == b"time_s\n0.0\n"
        refused = await shop.do("refuse")
        assert not job_of(refused).has_result
        with pytest.raises(Conflict):
            await shop.store.result(refused.id)

    in_shop(act)


@pytest.mark.parametrize(
    ("kind", "state", "code", "words"),
    [
        ("refuse", "failed", "no-plates", "The recording has no plates."),
        ("stumble", "failed", "computation-failed", "something unforeseen"),
        ("segfault", "failed", "computation-crashed", "SIGSEGV"),
        ("abort", "failed", "computation-crashed", "SIGABRT"),
        ("hog", "failed", "computation-out-of-memory", "more memory"),
        ("hang", "timed_out", "computation-timed-out", "1 s"),
    ],
)
def test_a_failing_computation_fails_only_its_own_job(
    in_shop: Open, kind: str, state: str, code: str, words: str
) -> None:
    async def act(shop: Shop) -> None:
        record = await shop.do(kind, bytes=4 << 30)
        assert record.state == state
        assert record.error is not None
        assert record.error["code"] == code
        assert words in record.error["detail"]
        assert record.attempt == 1  # a result, not a reason to try again
        assert (await shop.do("work")).state == "succeeded"

    in_shop(act)


@pytest.mark.parametrize(
    ("kind", "state", "code"),
    [
        ("hang-in-a-stage", "timed_out", "computation-timed-out"),
        ("stumble-in-a-stage", "failed", "computation-failed"),
    ],
)
def test_a_computation_that_hangs_is_located_by_its_last_stage(in_shop: Open, kind: str, state: str, code: str) -> None:
    async def act(shop: Shop) -> None:
        record = await shop.do(kind)
        assert record.state == state
        assert record.error is not None
        assert record.error["code"] == code
        assert record.error["errors"] == [
            {"where": "stage: centroidal", "message": "last progress message: centroidal: solving"}
        ]
        assert record.error["detail"].endswith("Last progress message: centroidal: solving.")

    in_shop(act)


def test_every_line_about_a_job_carries_its_id(in_shop: Open) -> None:
    async def act(shop: Shop) -> None:
        with structlog.testing.capture_logs(processors=[structlog.contextvars.merge_contextvars]) as lines:
            record = await shop.do("work")
            while not any(line["event"] == "job-ended" for line in lines):
                await asyncio.sleep(0.02)
        (line,) = [line for line in lines if line["event"] == "job-ended"]
        assert (line["job_id"], line["kind"], line["attempt"], line["state"]) == (record.id, "work", 1, "succeeded")

    in_shop(act)


def test_log_tail_shows_where_it_happened(in_shop: Open) -> None:
    async def act(shop: Shop) -> None:
        crashed = await shop.do("segfault")
        stumbled = await shop.do("stumble")
        assert "in segfault" in str(crashed.log_tail)
        assert "something unforeseen" in str(stumbled.log_tail)

    in_shop(act)


async def parts_of(shop: Shop, job_id: str, n: int, after: str | None = None) -> PartialResults:
    until = time.monotonic() + 60.0
    while time.monotonic() < until:
        parts = await shop.store.partial_results(job_id, after)
        if len(parts.chunks) >= n:
            return parts
        await asyncio.sleep(0.05)
    raise AssertionError(f"{len(parts.chunks)} parts after 60 s")


def test_parts_are_there_while_a_job_runs_and_gone_with_its_end(in_shop: Open, tmp_path: Path) -> None:
    async def act(shop: Shop) -> None:
        task = {"release": str(tmp_path / "go"), "n": 3}
        job_id = (await shop.store.submit("show-parts", task)).job_id
        parts = await parts_of(shop, job_id, 3)
        assert [chunk.run for chunk in parts.chunks if isinstance(chunk, PartialMotion)] == [1, 2, 3]
        number = parts.attempt
        assert (parts.job_id, parts.state, parts.next) == (job_id, "running", f"{number}.3")
        later = await shop.store.partial_results(job_id, f"{number}.2")
        assert [chunk.run for chunk in later.chunks if isinstance(chunk, PartialMotion)] == [3]
        assert (await shop.store.partial_results(job_id, f"{number}.3")).chunks == []
        assert len((await shop.store.partial_results(job_id, f"{number + 6}.3")).chunks) == 3  # of another attempt
        with pytest.raises(Conflict, match="no result yet"):
            await shop.store.result(job_id)
        (tmp_path / "go").touch()
        assert (await shop.ended(job_id)).state == "succeeded"
        assert (await shop.store.result(job_id)).artifacts == []
        ended = await shop.store.partial_results(job_id, "1.2")
        assert (ended.state, ended.chunks) == ("succeeded", [])

    in_shop(act)


def test_a_cancelled_job_leaves_no_parts(in_shop: Open, tmp_path: Path, database_url: str) -> None:
    async def act(shop: Shop) -> None:
        job_id = (await shop.store.submit("show-parts", {"release": str(tmp_path / "never")})).job_id
        await parts_of(shop, job_id, 2)
        await shop.store.request_cancel(job_id)
        assert (await shop.ended(job_id, 5.0)).state == "cancelled"
        assert (await shop.store.partial_results(job_id, None)).chunks == []

    in_shop(act)
    with psycopg.connect(database_url) as connection:
        assert connection.execute("SELECT count(*) FROM job_partial").fetchone() == (0,)


@pytest.mark.parametrize("file", ["link", "pipe", "folder", "large", "other", "text", "replaced"])
def test_a_wrong_part_ends_the_parts_and_not_the_job(in_shop: Open, tmp_path: Path, file: str) -> None:
    """A child that was taken over can neither show other files nor stop its worker."""
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "elsewhere" / "000003.json").write_text('{"kind": "certificate", "checks": [], "passed": false}')

    async def act(shop: Shop) -> None:
        task = {"release": str(tmp_path / "go"), "file": file, "elsewhere": str(tmp_path / "elsewhere")}
        job_id = (await shop.store.submit("show-parts", task)).job_id
        for _ in range(10):  # also while the computation goes on
            parts = await parts_of(shop, job_id, 2)
            assert [chunk.kind for chunk in parts.chunks] == ["motion", "motion"]
            await asyncio.sleep(0.05)
        (tmp_path / "go").touch()
        assert (await shop.ended(job_id)).state == "succeeded"

    in_shop(act)


def test_cancelling_a_running_job_frees_the_processor(in_shop: Open) -> None:
    async def act(shop: Shop) -> None:
        job_id = (await shop.store.submit("spin", {})).job_id
        while not (record := await shop.running(job_id)).message.startswith("pid"):
            await asyncio.sleep(0.02)
        pid = int(record.message.split()[1])
        assert psutil.pid_exists(pid)
        cancellation = await shop.store.request_cancel(job_id)
        assert cancellation.state == "running"
        assert cancellation.cancel_requested
        ended = await shop.ended(job_id, 5.0)
        assert ended.state == "cancelled"
        assert ended.error is None
        assert not psutil.pid_exists(pid)

    in_shop(act)


def test_a_long_job_does_not_block_short_ones(in_shop: Open) -> None:
    async def act(shop: Shop) -> None:
        long_job = (await shop.store.submit("spin", {})).job_id
        await shop.running(long_job)
        assert (await shop.do("work", timeout_s=10.0)).state == "succeeded"
        assert (await shop.store.get(long_job)).state == "running"
        await shop.store.request_cancel(long_job)

    in_shop(act)


def test_priorities_order_the_jobs_that_wait_for_slots(in_shop: Open, tmp_path: Path) -> None:
    diary = tmp_path / "diary"

    async def act(shop: Shop) -> None:
        first = (await shop.store.submit("long-work", {"work_s": 1.0, "diary": str(diary), "name": "first"})).job_id
        await shop.running(first)
        ids = []
        for priority, name in ((0, "a"), (0, "b"), (5, "c"), (10, "d")):
            task = {"diary": str(diary), "name": name}
            ids.append((await shop.store.submit("long-work", task, priority=priority)).job_id)
        for job_id in ids:
            assert (await shop.ended(job_id)).state == "succeeded"
        started = [line.split()[0] for line in diary.read_text().splitlines() if line.endswith("start")]
        assert started == ["first", "d", "c", "a", "b"]

    in_shop(act)


def test_events_can_be_followed_and_resumed(in_shop: Open) -> None:
    async def act(shop: Shop) -> None:
        job_id = (await shop.store.submit("work", {"work_s": 0.6})).job_id
        events_received = [event async for events in shop.board.follow_events(shop.store, job_id) for event in events]
        assert events_received[0].state == "queued"
        assert events_received[-1].state == "succeeded"
        again = [
            e async for events in shop.board.follow_events(shop.store, job_id, events_received[2].seq) for e in events
        ]
        assert again == events_received[3:]

    in_shop(act)


def test_a_stopping_worker_hands_its_job_back(in_shop: Open, database_url: str, tmp_path: Path) -> None:
    job_ids: list[str] = []

    async def leave(shop: Shop) -> None:
        job_ids.append((await shop.store.submit("long-work", {"work_s": 1.5})).job_id)
        await shop.running(job_ids[0])
        shop.worker.stop()
        await asyncio.sleep(0.5)
        record = await shop.store.get(job_ids[0])
        assert (record.state, record.attempt) == ("queued", 1)

    async def come_back(shop: Shop) -> None:
        record = await shop.ended(job_ids[0])
        assert (record.state, record.attempt) == ("succeeded", 2)
        assert await shop.blobs.exists(f"{attempt_prefix(record.id, 2, record.started_at)}/numbers.csv")

    in_shop(leave)
    in_shop(come_back)


def test_the_work_folder_is_empty_afterwards(in_shop: Open, tmp_path: Path) -> None:
    async def act(shop: Shop) -> None:
        await shop.do("work")
        await shop.do("stumble")

    in_shop(act)
    assert list((tmp_path / "work").iterdir()) == []


def test_children_of_the_worker_are_gone_afterwards(in_shop: Open) -> None:
    others = set(nurseries())  # of an application that serves other tests of this process

    async def act(shop: Shop) -> None:
        await shop.do("work")
        assert set(nurseries()) - others

    in_shop(act)
    time.sleep(0.1)
    assert set(nurseries()) <= others


def nurseries() -> list[psutil.Process]:
    """Processes that children are forked from, of whoever works within this one."""
    mine = psutil.Process(os.getpid()).children()
    return [process for process in mine if "stridelab.service.processes.fork_server" in process.cmdline()]
