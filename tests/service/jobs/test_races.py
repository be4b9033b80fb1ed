"""Races that only the database can decide: two reapers and one orphan, and a clock that jumps."""

import asyncio
from collections.abc import Callable, Coroutine
from typing import Any

import psycopg
import pytest

from stridelab.service.jobs.attempts import Attempt, AttemptStore
from stridelab.service.jobs.queue import LANES
from stridelab.service.jobs.queue_consumer import QueueConsumer
from stridelab.service.jobs.store import JobStore
from stridelab.service.storage.database import make_engine
from support.service.job_kinds import KINDS

STALL_S = 20.0
Work = Callable[[JobStore, AttemptStore, list[QueueConsumer]], Coroutine[Any, Any, None]]


@pytest.fixture
def with_consumers(database_url: str) -> Callable[[int, Work], None]:
    """Run an asynchronous function beside some registered workers."""

    def run(number: int, act: Work) -> None:
        async def inside() -> None:
            engine = make_engine(database_url)
            consumers = [QueueConsumer(database_url) for _ in range(number)]
            try:
                for consumer in consumers:
                    await consumer.__aenter__()
                    await consumer.send_heartbeat()
                await act(JobStore(engine, KINDS), AttemptStore(engine, KINDS), consumers)
            finally:
                for consumer in consumers:
                    await consumer.__aexit__()
                await engine.dispose()

        asyncio.run(inside())

    return run


async def take(attempts: AttemptStore, consumer: QueueConsumer) -> Attempt | None:
    delivery = await consumer.fetch_delivery(LANES)
    return None if delivery is None else await attempts.start_attempt(delivery)


def shift(url: str, seconds: float) -> None:
    """Let the database's clock be ``seconds`` ahead: what was written before looks that much older."""
    with psycopg.connect(url) as connection:
        connection.execute(
            "UPDATE procrastinate_workers SET last_heartbeat = last_heartbeat - make_interval(secs => %s)", (seconds,)
        )


def test_of_workers_that_race_for_an_orphan_one_gets_it(
    database_url: str, with_consumers: Callable[[int, Work], None]
) -> None:
    async def act(store: JobStore, attempts: AttemptStore, consumers: list[QueueConsumer]) -> None:
        dead, *living = consumers
        for number in range(1, 11):
            job_id = (await store.submit("work", {"n": number})).job_id
            lost = await take(attempts, dead)
            assert lost is not None
            await asyncio.to_thread(shift, database_url, 2 * STALL_S)
            await asyncio.gather(*(consumer.send_heartbeat() for consumer in living))
            found = await asyncio.gather(*(attempts.requeue_lost(STALL_S) for _ in living))
            assert [ids for ids in found if ids] == [[job_id]]
            taken = [a for a in await asyncio.gather(*(take(attempts, consumer) for consumer in living)) if a]
            assert [(one.job_id, one.number) for one in taken] == [(job_id, 2)]
            ends = await asyncio.gather(*(attempts.end_attempt(one, "failed", None, "") for one in (lost, taken[0])))
            assert ends == [False, True]

    with_consumers(5, act)


def test_clock_that_jumps_forward_costs_a_start_and_no_job(
    database_url: str, with_consumers: Callable[[int, Work], None]
) -> None:
    """All running jobs are taken away at once; those who run them hear of it, and each ends once."""

    async def act(store: JobStore, attempts: AttemptStore, consumers: list[QueueConsumer]) -> None:
        one, other = consumers
        ids = {(await store.submit("work", {"n": n})).job_id for n in range(2)}
        before = [await take(attempts, one), await take(attempts, other)]
        await asyncio.to_thread(shift, database_url, 3600.0)
        await one.send_heartbeat()  # the first to beat after the jump takes the other's job, not its own
        assert len(await attempts.requeue_lost(STALL_S)) == 1
        assert before[0] is not None
        assert before[1] is not None
        assert await attempts.report_progress(before[0], 0.5, "on")
        assert await attempts.should_stop(before[1])
        await other.send_heartbeat()
        again = await take(attempts, other)
        assert again is not None
        assert (again.job_id, again.number) == (before[1].job_id, 2)
        for attempt, ended in ((before[1], False), (again, True), (before[0], True)):
            assert await attempts.end_attempt(attempt, "failed", None, "") is ended
        assert {before[0].job_id, again.job_id} == ids

    with_consumers(2, act)


def test_clock_that_jumps_back_takes_nothing_away(
    database_url: str, with_consumers: Callable[[int, Work], None]
) -> None:
    async def act(store: JobStore, attempts: AttemptStore, consumers: list[QueueConsumer]) -> None:
        await store.submit("work", {})
        mine = await take(attempts, consumers[0])
        assert mine is not None
        await asyncio.to_thread(shift, database_url, -3600.0)
        assert await attempts.requeue_lost(STALL_S) == []
        await consumers[0].send_heartbeat()
        assert await attempts.requeue_lost(STALL_S) == []
        assert await attempts.end_attempt(mine, "failed", None, "")

    with_consumers(1, act)


def test_delivery_of_an_ended_job_is_closed_for_a_worker_that_died_before_it_could(
    database_url: str, with_consumers: Callable[[int, Work], None]
) -> None:
    async def act(store: JobStore, attempts: AttemptStore, consumers: list[QueueConsumer]) -> None:
        await store.submit("work", {})
        mine = await take(attempts, consumers[0])
        assert mine is not None
        await attempts.end_attempt(mine, "failed", None, "")

        def open_deliveries() -> int:
            with psycopg.connect(database_url) as look:
                rows = look.execute("SELECT id FROM procrastinate_jobs WHERE status = 'doing'").fetchall()
            return len(rows)

        assert await attempts.requeue_lost(STALL_S) == []
        assert await asyncio.to_thread(open_deliveries) == 1  # its worker lives: it will
        await asyncio.to_thread(shift, database_url, 2 * STALL_S)
        assert await attempts.requeue_lost(STALL_S) == []
        assert await asyncio.to_thread(open_deliveries) == 0

    with_consumers(1, act)
