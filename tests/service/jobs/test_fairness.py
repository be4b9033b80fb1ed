"""Fairness of the queue: many jobs of one owner do not delay the few of another."""

import asyncio
from collections import Counter, defaultdict
from collections.abc import Awaitable, Callable
from typing import Any

import psycopg
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stridelab.service.jobs.attempts import AttemptStore
from stridelab.service.jobs.queue import LANES, Attempt, QueueConsumer
from stridelab.service.jobs.store import JobStore
from stridelab.service.storage.blobs import BlobStore
from stridelab.service.storage.database import make_engine
from support.service.database import TestDatabases
from support.service.job_kinds import KINDS

OUTCOME: dict[str, Any] = {"summary": {}, "references": [], "artifacts": []}
OWNERS = ("anna", "ben", "carla", None)


class Queue:
    """Owners that submit jobs, and slots that fetch and finish them, on a real database."""

    def __init__(self, url: str, folder: Any) -> None:
        self.engine, self.consumer, self.folder = make_engine(url), QueueConsumer(url), folder
        self.store, self.attempts = JobStore(self.engine, KINDS, queue_limit=10**6), AttemptStore(self.engine, KINDS)
        self.blobs = BlobStore.from_url(folder.as_uri())
        self.owner: dict[str, str | None] = {}
        self.rank: dict[str, tuple[int, int]] = {}
        self.waiting: dict[str | None, list[str]] = defaultdict(list)
        self.held: dict[str, Attempt] = {}

    async def submit(self, owner: str | None, priority: int = 0) -> str:
        job_id = (await self.store.submit("work", {}, owner=owner, priority=priority)).job_id
        self.owner[job_id], self.rank[job_id] = owner, (-priority, len(self.rank))
        self.waiting[owner].append(job_id)
        return job_id

    async def fetch(self) -> str | None:
        attempt = await self.consumer.claim_attempt(LANES)
        if attempt is None:
            return None
        self.held[attempt.job_id] = attempt
        self.waiting[self.owner[attempt.job_id]].remove(attempt.job_id)
        return attempt.job_id

    async def finish(self, job_id: str) -> None:
        attempt = self.held.pop(job_id)
        assert await self.attempts.publish_success(attempt, self.blobs, OUTCOME, [], self.folder, "")
        self.consumer.release_attempt(attempt)

    def in_hand(self, owner: str | None) -> int:
        return sum(self.owner[job_id] == owner for job_id in self.held)

    def waits(self) -> list[str | None]:
        return [owner for owner, jobs in self.waiting.items() if jobs]


@pytest.fixture(scope="module")
def queue(postgres: TestDatabases, tmp_path_factory: pytest.TempPathFactory) -> Any:
    """Run an asynchronous function with an empty queue."""
    with postgres.fresh() as url:

        def run(act: Callable[[Queue], Awaitable[Any]]) -> Any:
            async def inside() -> Any:
                new_queue = Queue(url, tmp_path_factory.mktemp("blobs"))
                try:
                    return await act(new_queue)
                finally:
                    await new_queue.consumer.close()
                    await new_queue.engine.dispose()

            with psycopg.connect(url) as connection:
                connection.execute("TRUNCATE job, job_event CASCADE")
            return asyncio.run(inside())

        yield run


submissions = st.tuples(st.sampled_from(OWNERS), st.integers(-1, 1))
endings = st.integers(0, 2)
"""Which of the running jobs ends where no slot is free."""


@settings(max_examples=25)
@given(moves=st.lists(st.one_of(submissions, endings), min_size=4, max_size=30), slots=st.integers(1, 3))
def test_turns_are_fair_whatever_is_submitted(queue: Any, moves: list[Any], slots: int) -> None:
    async def act(jobs: Queue) -> None:
        passed_over: Counter[tuple[str | None, str | None]] = Counter()
        running: list[str] = []

        async def slot(ending: int = 0) -> bool:
            if len(running) == slots:
                await jobs.finish(running.pop(ending % slots))
            waiting = {owner: list(jobs.waiting[owner]) for owner in jobs.waits()}
            in_hand = {owner: jobs.in_hand(owner) for owner in waiting}
            job_id = await jobs.fetch()
            if job_id is None:
                assert not waiting
                return False
            running.append(job_id)
            winner = jobs.owner[job_id]
            # of one's own jobs, the most urgent, then the oldest
            assert job_id == min(waiting[winner], key=jobs.rank.__getitem__)
            for other in waiting:
                passed_over[other, winner] += other != winner
                if other != winner:
                    # no owner gets another slot while an owner has fewer ...
                    assert in_hand[winner] <= in_hand[other]
                    # ... and an owner without a slot is passed over once by each of the others at most
                    assert in_hand[other] > 0 or passed_over[other, winner] <= 1
            for rival in OWNERS:
                passed_over[winner, rival] = 0
            return True

        for move in moves:
            if isinstance(move, int):
                await slot(move)
            else:
                await jobs.submit(*move)
        while await slot():
            pass
        while running:
            await jobs.finish(running.pop(0))
        assert not any(jobs.waiting.values())

    queue(act)


def test_a_single_job_does_not_wait_for_a_hundred_of_somebody_else(queue: Any) -> None:
    async def act(jobs: Queue) -> None:
        for _ in range(100):
            await jobs.submit("many", priority=100)
        running = await jobs.fetch()
        assert running is not None
        single = await jobs.submit("one", priority=-100)
        assert (await jobs.store.get(single)).queue_position == 2
        await jobs.finish(running)
        assert await jobs.fetch() == single

    queue(act)


def test_a_user_with_a_slot_gets_another_after_users_without_one(queue: Any) -> None:
    async def act(jobs: Queue) -> None:
        long_job, next_job = await jobs.submit("anna"), await jobs.submit("anna")
        short_jobs = [await jobs.submit("ben") for _ in range(3)]
        assert await jobs.fetch() == long_job
        for job_id in short_jobs:  # though ben was served later each time
            assert await jobs.fetch() == job_id
            await jobs.finish(job_id)
        assert await jobs.fetch() == next_job

    queue(act)


def test_a_job_that_was_deleted_is_not_handed_out(queue: Any) -> None:
    async def act(jobs: Queue) -> None:
        await jobs.submit("anna")
        async with jobs.engine.begin() as connection:
            await connection.exec_driver_sql("DELETE FROM job")
        assert await jobs.consumer.claim_attempt(LANES) is None

    queue(act)


@pytest.mark.parametrize("how", ["its worker died", "its worker left", "its process was killed"])
def test_a_job_that_comes_back_keeps_its_place(queue: Any, how: str) -> None:
    """Before jobs that were submitted later, one's own and those of owners who are served in turn."""

    async def act(jobs: Queue) -> None:
        first, second = await jobs.submit("anna"), await jobs.submit("anna")
        assert await jobs.fetch() == first
        await jobs.submit("ben")
        attempt = jobs.held.pop(first)
        if how == "its worker died":
            await jobs.consumer.unregister_worker()
            assert await jobs.attempts.requeue_lost(None) == [first]
        else:
            assert await jobs.attempts.hand_back(attempt, counts=how == "its process was killed")
            jobs.consumer.release_attempt(attempt)
        jobs.waiting["anna"].insert(0, first)
        assert (await jobs.store.get(first)).queue_position == 1
        assert (await jobs.store.get(second)).queue_position == 3
        assert await jobs.fetch() == first

    queue(act)
