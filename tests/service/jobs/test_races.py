"""Races that only the database can decide: two reapers and one orphan, and a clock that jumps."""

import asyncio
from collections.abc import Callable, Coroutine
from typing import Any

import psycopg
import pytest
from sqlalchemy import event

from stridelab.service.jobs import queue
from stridelab.service.jobs.attempts import AttemptStore
from stridelab.service.jobs.queue import DATABASE_UNAVAILABLE, LANES, Attempt, QueueConsumer
from stridelab.service.jobs.store import JobStore
from stridelab.service.storage.database import make_engine
from support.service.job_kinds import KINDS
from support.service.processes import wait_until

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
                    await consumer.send_heartbeat()
                await act(JobStore(engine, KINDS), AttemptStore(engine, KINDS), consumers)
            finally:
                for consumer in consumers:
                    await consumer.close()
                await engine.dispose()

        asyncio.run(inside())

    return run


async def take(consumer: QueueConsumer) -> Attempt | None:
    return await consumer.claim_attempt(LANES)


def shift(url: str, seconds: float) -> None:
    """Let the database's clock be ``seconds`` ahead: what was written before looks that much older."""
    with psycopg.connect(url) as connection:
        connection.execute("UPDATE worker SET last_heartbeat = last_heartbeat - make_interval(secs => %s)", (seconds,))


def test_of_workers_that_race_for_an_orphan_one_gets_it(
    database_url: str, with_consumers: Callable[[int, Work], None]
) -> None:
    async def act(store: JobStore, attempts: AttemptStore, consumers: list[QueueConsumer]) -> None:
        dead, *living = consumers
        for number in range(1, 11):
            job_id = (await store.submit("work", {"n": number})).job_id
            lost = await take(dead)
            assert lost is not None
            await asyncio.to_thread(shift, database_url, 2 * STALL_S)
            await asyncio.gather(*(consumer.send_heartbeat() for consumer in living))
            requeued = await asyncio.gather(*(attempts.requeue_lost(STALL_S) for _ in living))
            assert [ids for ids in requeued if ids] == [[job_id]]
            attempts_taken = [a for a in await asyncio.gather(*(take(consumer) for consumer in living)) if a]
            assert [(one.job_id, one.number) for one in attempts_taken] == [(job_id, 2)]
            ends = await asyncio.gather(
                *(attempts.end_attempt(one, "failed", None, "") for one in (lost, attempts_taken[0]))
            )
            assert ends == [False, True]

    with_consumers(5, act)


def test_a_job_taken_from_a_living_worker_costs_an_attempt_and_no_job(
    database_url: str, with_consumers: Callable[[int, Work], None]
) -> None:
    """Its worker is notified, and each job ends once."""

    async def act(store: JobStore, attempts: AttemptStore, consumers: list[QueueConsumer]) -> None:
        one, other = consumers
        ids = {(await store.submit("work", {"n": n})).job_id for n in range(2)}
        before = [await take(one), await take(other)]
        await asyncio.to_thread(shift, database_url, 3600.0)
        await one.send_heartbeat()  # the clock has jumped forward; workers wait then, the store does not
        assert len(await attempts.requeue_lost(STALL_S)) == 1
        assert before[0] is not None
        assert before[1] is not None
        assert await attempts.report_progress(before[0], 0.5, "on")
        assert await attempts.should_stop(before[1])
        await other.send_heartbeat()
        again = await take(other)
        assert again is not None
        assert (again.job_id, again.number) == (before[1].job_id, 2)
        for attempt, ended in ((before[1], False), (again, True), (before[0], True)):
            assert await attempts.end_attempt(attempt, "failed", None, "") is ended
        assert {before[0].job_id, again.job_id} == ids

    with_consumers(2, act)


def test_a_clock_that_jumps_after_the_heartbeat_of_the_reaper_loses_nothing(
    database_url: str, with_consumers: Callable[[int, Work], None]
) -> None:
    """Between its heartbeat and its query, all heartbeats become old; a worker that is not registered is lost still."""

    async def act(store: JobStore, attempts: AttemptStore, consumers: list[QueueConsumer]) -> None:
        reaper, other, removed = consumers
        for number in range(3):
            await store.submit("work", {"n": number})
        _, _, orphan = [await take(one) for one in consumers]
        assert orphan is not None
        with psycopg.connect(database_url) as connection:
            connection.execute("DELETE FROM worker WHERE id = %s", (removed.worker_id,))
        await asyncio.gather(*(one.send_heartbeat() for one in (reaper, other)))
        await asyncio.to_thread(shift, database_url, 3600.0)
        assert await attempts.requeue_lost(STALL_S, reaper.worker_id) == [orphan.job_id]
        assert len(await attempts.requeue_lost(STALL_S)) == 2, "without the reaper's own heartbeat as a witness"

    with_consumers(3, act)


def test_a_clock_that_jumps_back_loses_nothing(database_url: str, with_consumers: Callable[[int, Work], None]) -> None:
    async def act(store: JobStore, attempts: AttemptStore, consumers: list[QueueConsumer]) -> None:
        await store.submit("work", {})
        mine = await take(consumers[0])
        assert mine is not None
        await asyncio.to_thread(shift, database_url, -3600.0)
        assert await attempts.requeue_lost(STALL_S) == []
        await consumers[0].send_heartbeat()
        assert await attempts.requeue_lost(STALL_S) == []
        assert await attempts.end_attempt(mine, "failed", None, "")

    with_consumers(1, act)


def test_a_clock_that_jumps_back_hides_no_dead_worker(
    database_url: str, with_consumers: Callable[[int, Work], None]
) -> None:
    """A worker that died before the jump is lost after the stall time, not after an hour."""

    async def act(store: JobStore, attempts: AttemptStore, consumers: list[QueueConsumer]) -> None:
        dead, alive = consumers
        job_id = (await store.submit("work", {})).job_id
        assert await take(dead) is not None
        await asyncio.to_thread(shift, database_url, -3600.0)
        assert await attempts.requeue_lost(STALL_S) == []
        await asyncio.to_thread(shift, database_url, STALL_S + 1.0)
        await alive.send_heartbeat()
        assert await attempts.requeue_lost(STALL_S) == [job_id]

    with_consumers(2, act)


def test_concurrent_claims_start_every_job_once(database_url: str, with_consumers: Callable[[int, Work], None]) -> None:
    """A worker that finds the first job of an owner locked gets the next one; every worker gets a job."""

    async def act(store: JobStore, attempts: AttemptStore, consumers: list[QueueConsumer]) -> None:
        ids = [(await store.submit("work", {"n": n})).job_id for n in range(40)]
        attempts_taken: list[Attempt | None] = []
        for _ in range(8):
            attempts_taken += await asyncio.gather(*(take(one) for one in consumers))
        assert sorted(each.job_id for each in attempts_taken if each) == sorted(ids)
        assert await asyncio.gather(*(take(one) for one in consumers)) == [None] * 5

    with_consumers(5, act)


def test_a_claim_whose_answer_was_lost_is_answered_again_in_its_lane(
    database_url: str, with_consumers: Callable[[int, Work], None]
) -> None:
    async def act(store: JobStore, attempts: AttemptStore, consumers: list[QueueConsumer]) -> None:
        one, other = consumers
        job_id = (await store.submit("long-work", {})).job_id

        def lose_the_answer(_connection: object, _cursor: object, statement: str, *_: object) -> None:
            if "WITH RECURSIVE first" in statement:
                raise psycopg.OperationalError("the connection is closed")

        engine = one._engine.sync_engine
        event.listen(engine, "after_cursor_execute", lose_the_answer)
        with pytest.raises(DATABASE_UNAVAILABLE):
            await take(one)
        event.remove(engine, "after_cursor_execute", lose_the_answer)
        record = await store.get(job_id)
        assert (record.state, record.attempt) == ("running", 1)
        assert await one.claim_attempt(["short"]) is None
        assert await take(other) is None
        again = await take(one)
        assert again is not None
        assert (again.job_id, again.number) == (job_id, 1)
        assert await take(one) is None

    with_consumers(2, act)


def test_a_job_that_a_restored_database_gives_to_a_worker_is_taken_up(
    database_url: str, with_consumers: Callable[[int, Work], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    async def act(store: JobStore, attempts: AttemptStore, consumers: list[QueueConsumer]) -> None:
        (one,) = consumers
        job_id = (await store.submit("work", {})).job_id
        attempt = await take(one)
        assert attempt is not None
        with psycopg.connect(database_url) as connection:
            connection.execute("CREATE TABLE yesterday AS SELECT * FROM job")
        assert await attempts.end_attempt(attempt, "cancelled", None, "")
        one.release_attempt(attempt)
        with psycopg.connect(database_url) as connection:
            connection.execute("UPDATE job SET state = yesterday.state FROM yesterday")
        assert await attempts.requeue_lost(STALL_S) == [], "its worker is alive"
        assert await take(one) is None, "it has just looked"
        monkeypatch.setattr(queue, "CHECK_S", 0.0)
        again = await take(one)
        assert again is not None
        assert (again.job_id, again.number) == (job_id, attempt.number)

    with_consumers(1, act)


def restore_waiting_job(url: str, job_id: str) -> None:
    """Bring the job back to where it was before its first start, as a backup from yesterday does."""
    with psycopg.connect(url) as connection:
        connection.execute(
            "UPDATE job SET state = 'queued', attempt = 0, worker_id = NULL, started_at = NULL WHERE id = %s", (job_id,)
        )


def test_a_restored_job_is_no_longer_that_of_the_worker_that_runs_it(
    database_url: str, with_consumers: Callable[[int, Work], None]
) -> None:
    """Its next start has the same number and other files; the earlier one can neither publish nor be taken for it."""

    async def act(store: JobStore, attempts: AttemptStore, consumers: list[QueueConsumer]) -> None:
        one, other = consumers
        job_id = (await store.submit("work", {})).job_id
        old = await take(one)
        await asyncio.to_thread(restore_waiting_job, database_url, job_id)
        new = await take(other)
        assert old is not None
        assert new is not None
        assert (old.job_id, old.number) == (new.job_id, new.number) == (job_id, 1)
        assert old.blob_prefix != new.blob_prefix
        assert await attempts.should_stop(old)
        assert not await attempts.report_progress(old, 0.5, "on")
        assert not await attempts.hand_back(old)
        assert not await attempts.end_attempt(old, "cancelled", None, "")
        assert not await attempts.should_stop(new)
        assert await attempts.end_attempt(new, "cancelled", None, "")
        assert not await attempts.end_attempt(old, "cancelled", None, ""), "the same end, but of the other start"

    with_consumers(2, act)


def test_a_worker_that_starts_a_restored_job_again_holds_both_starts(
    database_url: str, with_consumers: Callable[[int, Work], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    async def act(store: JobStore, _attempts: AttemptStore, consumers: list[QueueConsumer]) -> None:
        (one,) = consumers
        job_id = (await store.submit("work", {})).job_id
        old = await take(one)
        await asyncio.to_thread(restore_waiting_job, database_url, job_id)
        new = await take(one)
        assert old is not None
        assert new is not None
        one.release_attempt(old)
        monkeypatch.setattr(queue, "CHECK_S", 0.0)
        assert await take(one) is None

    with_consumers(1, act)


def test_workers_that_a_restored_database_does_not_know_stay_apart(
    database_url: str, with_consumers: Callable[[int, Work], None]
) -> None:
    """None of them gets the id of another one, whose jobs it would take for its own."""

    async def act(_store: JobStore, _attempts: AttemptStore, consumers: list[QueueConsumer]) -> None:
        before = {one.worker_id for one in consumers}
        with psycopg.connect(database_url) as connection:
            connection.execute("TRUNCATE worker RESTART IDENTITY")
        for one in reversed(consumers):
            await one.send_heartbeat()
        assert not before & {one.worker_id for one in consumers}
        assert len({one.worker_id for one in consumers}) == len(consumers)

    with_consumers(3, act)


def test_claim_reads_few_rows_however_many_wait(database_url: str, with_consumers: Callable[[int, Work], None]) -> None:
    """Whatever the statistics say: here they are of an empty table."""
    read = "SELECT seq_tup_read + idx_tup_fetch FROM pg_stat_user_tables WHERE relname = 'job'"

    async def act(store: JobStore, attempts: AttemptStore, consumers: list[QueueConsumer]) -> None:
        attempt = await take(consumers[0])
        assert attempt is not None
        assert attempt.job_id == "waiting 1"

    with psycopg.connect(database_url, autocommit=True) as look:
        look.execute(
            "INSERT INTO job (id, kind, input, input_hash, owner, created_at)"
            " SELECT 'waiting ' || n, 'work', '{}', 'h', 'owner ' || n % 3, now() + n * interval '1 ms'"
            " FROM generate_series(1, 2000) AS n"
        )
        look.execute("SELECT pg_stat_force_next_flush()")
        before = look.execute(read).fetchone()
        with_consumers(1, act)

        def rows_read() -> int:
            after = look.execute(read).fetchone()
            assert before is not None
            assert after is not None
            return int(after[0] - before[0])

        # a server process reports what it read when it ends
        wait_until(lambda: rows_read() > 0, 20, "the count of rows that were read")
        assert rows_read() < 50
