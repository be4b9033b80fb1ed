import asyncio
from collections.abc import Awaitable, Callable
from typing import Any, Protocol

import psycopg
import pytest
from sqlalchemy import event

from stridelab.errors import Busy, Conflict, InvalidInput, NotFound
from stridelab.service.jobs.queue import LANES, Attempt, QueueConsumer
from stridelab.service.jobs.store import JobStore
from support.service.database import run_with_engine
from support.service.job_kinds import KINDS


class Use(Protocol):
    def __call__(self, act: Callable[[JobStore], Awaitable[Any]], **options: Any) -> Any: ...


@pytest.fixture
def use(database_url: str) -> Use:
    """Run an asynchronous function with a store."""

    def run(act: Callable[[JobStore], Awaitable[Any]], **options: Any) -> Any:
        return run_with_engine(database_url, lambda engine: act(JobStore(engine, KINDS, **options)))

    return run


def test_submit_makes_row_and_event_together(use: Use, database_url: str) -> None:
    async def act(store: JobStore) -> None:
        submitted = await store.submit("work", {"a": 1}, owner="o", priority=3)
        assert submitted.created
        record = await store.get(submitted.job_id)
        assert (record.state, record.attempt, record.priority, record.owner) == ("queued", 0, 3, "o")
        assert record.input == {"a": 1}
        assert record.queue_position == 1
        (queued,) = await store.events_after(submitted.job_id)
        assert queued.state == "queued"

    use(act)
    with psycopg.connect(database_url) as connection:
        assert connection.execute("SELECT lane, priority, state FROM job").fetchall() == [("short", 3, "queued")]


def test_refused_submissions_leave_nothing(use: Use, database_url: str) -> None:
    async def act(store: JobStore) -> None:
        with pytest.raises(NotFound) as unknown:
            await store.submit("no-such-kind", {})
        with pytest.raises(NotFound) as orphan:
            await store.submit("work", {}, recording_id="gone")
        with pytest.raises(InvalidInput) as urgent:
            await store.submit("work", {}, priority=101)
        with pytest.raises(InvalidInput) as key:
            await store.submit("work", {}, idempotency_key="")
        codes = [caught.value.code for caught in (unknown, orphan, urgent, key)]
        assert codes == ["unknown-job-kind", "recording-not-found", "priority-out-of-range", "idempotency-key-invalid"]

    use(act)
    with psycopg.connect(database_url) as connection:
        for table in ("job", "job_event"):
            assert connection.execute(f"SELECT count(*) FROM {table}").fetchone() == (0,)


def test_same_key_and_body_is_the_same_job(use: Use) -> None:
    async def act(store: JobStore) -> None:
        first = await store.submit("work", {"a": 1, "b": 2}, owner="o", idempotency_key="k")
        again = await store.submit("work", {"b": 2, "a": 1}, owner="o", idempotency_key="k")
        assert (again.job_id, again.created) == (first.job_id, False)
        with pytest.raises(Conflict) as caught:
            await store.submit("work", {"a": 2}, owner="o", idempotency_key="k")
        assert caught.value.code == "idempotency-key-reused"
        with pytest.raises(Conflict):
            await store.submit("long-work", {"a": 1, "b": 2}, owner="o", idempotency_key="k")
        other_owner = await store.submit("work", {"a": 2}, owner="p", idempotency_key="k")
        anonymous = await store.submit("work", {"a": 2}, idempotency_key="k")
        assert other_owner.created
        assert anonymous.created
        assert not (await store.submit("work", {"a": 2}, idempotency_key="k")).created

    use(act)


def test_concurrent_duplicates_make_one_job(use: Use) -> None:
    async def act(store: JobStore) -> None:
        submissions = await asyncio.gather(*(store.submit("work", {"a": 1}, idempotency_key="k") for _ in range(12)))
        assert len({submitted.job_id for submitted in submissions}) == 1
        assert sum(submitted.created for submitted in submissions) == 1

    use(act)


def test_fifty_parallel_submissions_fill_the_queue_to_its_limit(use: Use) -> None:
    async def act(store: JobStore) -> None:
        submissions = await asyncio.gather(*(store.submit("work", {"n": n}) for n in range(50)), return_exceptions=True)
        refused = [answer for answer in submissions if isinstance(answer, Busy)]
        assert len(refused) == 40
        assert all(busy.code == "queue-full" and busy.retry_after_s > 0 for busy in refused)
        assert len((await store.list_jobs(limit=100)).items) == 10

    use(act, queue_limit=10)


def test_a_submission_is_one_round_trip(use: Use) -> None:
    """The lock of admission would otherwise be held while a busy event loop serves other requests."""
    statements: list[str] = []

    async def act(store: JobStore) -> None:
        await store.submit("work", {})
        event.listen(store._engine.sync_engine, "before_cursor_execute", lambda *call: statements.append(call[2]))
        await store.submit("work", {})

    use(act)
    assert len(statements) == 1


def test_a_repeated_key_returns_its_job_even_when_the_queue_is_full(use: Use) -> None:
    async def act(store: JobStore) -> None:
        first = await store.submit("work", {}, idempotency_key="k")
        with pytest.raises(Busy):
            await store.submit("work", {})
        assert (await store.submit("work", {}, idempotency_key="k")).job_id == first.job_id

    use(act, queue_limit=1)


def test_list_pages_newest_first_and_filters(use: Use) -> None:
    async def act(store: JobStore) -> None:
        job_ids = [(await store.submit("work" if n % 2 else "refuse", {"n": n})).job_id for n in range(7)]
        listed_ids: list[str] = []
        cursor = None
        while True:
            page = await store.list_jobs(limit=3, cursor=cursor)
            listed_ids += [record.id for record in page.items]
            cursor = page.next
            if cursor is None:
                break
        assert listed_ids == job_ids[::-1]
        assert [r.id for r in (await store.list_jobs(kind="work")).items] == job_ids[1::2][::-1]
        assert (await store.list_jobs(state="running")).items == ()
        assert (await store.list_jobs(recording_id="x")).items == ()
        with pytest.raises(InvalidInput) as caught:
            await store.list_jobs(cursor="not a cursor")
        assert caught.value.code == "invalid-cursor"

    use(act)


def test_jobs_of_a_recording_include_measures_of_several(use: Use, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("stridelab.service.jobs.store.POOLING_KINDS", ("work",))

    async def act(store: JobStore) -> None:
        both = (await store.submit("work", {"recording_ids": ["a", "b"]})).job_id
        await store.submit("refuse", {"recording_ids": ["a"]})
        await store.submit("work", {"recording_ids": ["ab"]})
        for one in ("a", "b"):
            assert [r.id for r in (await store.list_jobs(recording_id=one)).items] == [both]
        assert (await store.list_jobs(recording_id="c")).items == ()

    use(act)


def test_position_in_the_queue_follows_priority_then_age(use: Use) -> None:
    async def act(store: JobStore) -> None:
        ids = [(await store.submit("work", {}, priority=p)).job_id for p in (0, 0, 5, 10)]
        assert [(await store.get(job_id)).queue_position for job_id in ids] == [3, 4, 2, 1]
        await store.request_cancel(ids[3])
        assert [(await store.get(job_id)).queue_position for job_id in ids] == [2, 3, 1, None]

    use(act)


async def claim(url: str) -> Attempt | None:
    consumer = QueueConsumer(url)
    try:
        return await consumer.claim_attempt(LANES)
    finally:
        await consumer.close()


def test_cancelling_a_queued_job_ends_it_at_once(use: Use, database_url: str) -> None:
    async def act(store: JobStore) -> None:
        job_id = (await store.submit("work", {})).job_id
        record = await store.request_cancel(job_id)
        assert record.state == "cancelled"
        assert record.finished_at is not None
        assert (await store.request_cancel(job_id)).state == "cancelled"
        assert [event.state for event in await store.events_after(job_id)] == ["queued", "cancelled"]
        with pytest.raises(Conflict) as without:
            await store.result(job_id)
        assert without.value.code == "job-without-result"

    use(act)
    assert asyncio.run(claim(database_url)) is None


def test_unknown_jobs_and_unfinished_results(use: Use) -> None:
    async def act(store: JobStore) -> None:
        for call in (store.get, store.request_cancel, store.result):
            with pytest.raises(NotFound) as caught:
                await call("nothing")
            assert caught.value.code == "job-not-found"
        assert await store.events_after("nothing") == ()
        job_id = (await store.submit("work", {})).job_id
        with pytest.raises(Conflict) as early:
            await store.result(job_id)
        assert early.value.code == "job-not-finished"

    use(act)
