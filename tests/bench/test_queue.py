"""Latencies of the queue on the embedded database, with a worker in a process of its own; run by ``make bench``.

The bars: submitting to computing p50 below 50 ms, progress to a listening client p50 below 30 ms, cancelling to the
processor being free below 300 ms.
"""

import asyncio
import time
from collections.abc import AsyncGenerator, AsyncIterator, Iterator
from contextlib import AsyncExitStack
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest

from stridelab.client import Client
from stridelab.schemas.jobs import JobEvent
from stridelab.service.jobs.notifications import JobNotifications
from stridelab.service.jobs.store import JobRecord, JobStore
from stridelab.service.storage.database import make_engine
from support.service.database import TestDatabases
from support.service.job_kinds import KINDS
from support.service.processes import worker
from support.service.web_server import served

SPARE_S = 0.6
"""Between rounds, so that the next child is ready, as it is in a service that is not overrun."""


class Desk:
    """A client of the queue that stays connected from round to round."""

    def __init__(self, url: str) -> None:
        self.url = url
        self.runner, self.stack = asyncio.Runner(), AsyncExitStack()
        self.engine = make_engine(url)
        self.store, self.board = JobStore(self.engine, KINDS), JobNotifications(url)
        self.do(self.stack.enter_async_context(self.board))

    def do(self, act: Any) -> Any:
        return self.runner.run(act)

    def close(self) -> None:
        self.do(self.stack.aclose())
        self.do(self.engine.dispose())
        self.runner.close()

    def submit(self, kind: str, **task: Any) -> str:
        return str(self.do(self.store.submit(kind, task)).job_id)

    def until_running(self, job_id: str) -> JobRecord:
        while True:
            record = self.do(self.store.get(job_id))
            if record.state == "running" and record.message:
                return record
            time.sleep(0.02)

    def end(self, job_id: str) -> None:
        self.do(self.store.request_cancel(job_id))
        self.do(self.board.wait_for_end(self.store, job_id, 20.0))


@pytest.fixture(scope="module")
def desk(postgres: TestDatabases, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Desk]:
    folder = tmp_path_factory.mktemp("worker")
    with postgres.fresh() as url, worker(url, folder, STRIDELAB_WORKER_SLOTS="1"):
        opened = Desk(url)
        warm = opened.submit("work")
        opened.do(opened.board.wait_for_end(opened.store, warm, 60.0))
        yield opened
        opened.close()


def percentiles(benchmark: Any, name: str) -> float:
    """Note and print p50 and p95 in milliseconds; returns p50."""
    p50, p95 = np.percentile(np.array(benchmark.stats.stats.data) * 1e3, [50, 95])
    benchmark.extra_info.update(p50_ms=round(p50, 1), p95_ms=round(p95, 1))
    print(f"\n{name}: p50 {p50:.1f} ms, p95 {p95:.1f} ms, {len(benchmark.stats.stats.data)} rounds")
    return float(p50)


def test_submit_to_computing(benchmark: Any, desk: Desk, tmp_path: Path) -> None:
    mark = tmp_path / "mark"

    def pause() -> None:
        mark.unlink(missing_ok=True)
        time.sleep(SPARE_S)

    def until_computing() -> None:
        desk.submit("mark", mark=str(mark))
        while not mark.exists():
            time.sleep(0.0005)

    benchmark.pedantic(until_computing, setup=pause, rounds=40)
    assert percentiles(benchmark, "submit to computing") < 50


def test_progress_to_listener(benchmark: Any, desk: Desk, tmp_path: Path) -> None:
    mark = tmp_path / "mark"
    job_id = desk.submit("echo", mark=str(mark))
    mark.touch()
    desk.until_running(job_id)
    stream = desk.board.follow_events(desk.store, job_id)
    assert isinstance(stream, AsyncGenerator)

    async def next_event(events: AsyncIterator[tuple[JobEvent, ...]], message: str) -> None:
        async for batch in events:
            if any(event.progress.message == message for event in batch):
                return

    desk.do(next_event(stream, "heard 1"))
    heard = 1

    def until_notified() -> None:
        nonlocal heard
        heard += 1
        mark.touch()
        desk.do(next_event(stream, f"heard {heard}"))

    benchmark.pedantic(until_notified, setup=lambda: time.sleep(0.3), rounds=40)
    desk.do(stream.aclose())
    desk.end(job_id)
    assert percentiles(benchmark, "progress to listener") < 30


def test_progress_to_http_event_stream(benchmark: Any, desk: Desk, tmp_path: Path) -> None:
    mark = tmp_path / "mark"
    job_id = desk.submit("echo", mark=str(mark))
    mark.touch()
    desk.until_running(job_id)
    with served(desk.url, tmp_path / "data") as web, Client(web.base_url) as client:
        events = client.events(job_id)
        heard = 1
        while next(events).progress.message != "heard 1":
            pass

        def until_notified() -> None:
            nonlocal heard
            heard += 1
            mark.touch()
            while next(events).progress.message != f"heard {heard}":
                pass

        benchmark.pedantic(until_notified, setup=lambda: time.sleep(0.3), rounds=40)
        desk.end(job_id)
        assert [event.state for event in events][-1] == "cancelled"
    assert percentiles(benchmark, "progress to http event stream") < 30


def test_cancel_to_free_processor(benchmark: Any, desk: Desk) -> None:
    spinning: list[tuple[str, int]] = []

    def start() -> None:
        time.sleep(SPARE_S)
        job_id = desk.submit("spin")
        record = desk.until_running(job_id)
        spinning.append((job_id, int(record.message.split()[1])))

    def until_free() -> None:
        job_id, pid = spinning[-1]
        desk.do(desk.store.request_cancel(job_id))
        while psutil.pid_exists(pid):
            time.sleep(0.001)

    benchmark.pedantic(until_free, setup=start, rounds=20)
    desk.do(desk.board.wait_for_end(desk.store, spinning[-1][0], 20.0))
    percentiles(benchmark, "cancel to free processor")
    assert max(benchmark.stats.stats.data) < 0.3
