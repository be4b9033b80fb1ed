"""The job's state machine against a model, on a real database: workers that live, die, stall and come back."""

import asyncio
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import psycopg
import pytest
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule, run_state_machine_as_test

from stridelab.errors import Busy, Conflict
from stridelab.schemas.jobs import FINAL_STATES
from stridelab.service.jobs.attempts import AttemptStore
from stridelab.service.jobs.queue import LANES, Attempt, QueueConsumer
from stridelab.service.jobs.store import JobStore
from stridelab.service.storage.blobs import BlobStore
from stridelab.service.storage.database import make_engine
from support.service.job_kinds import KINDS

MAX_ATTEMPTS = 2
QUEUE_LIMIT = 4
PART = '{"kind":"certificate","checks":[],"passed":true}'
OUTCOME = {"summary": {"answer": 42}, "references": [], "artifacts": []}


@dataclass
class Model:
    """What a job should look like; ``holder`` is the worker that should be running it."""

    state: str = "queued"
    attempt: int = 0
    returned: int = 0
    priority: int = 0
    order: int = 0
    cancel_requested: bool = False
    error: str | None = None
    holder: int | None = None
    carried: bool = False
    """Whether a living worker runs it."""
    parts: list[int] = field(default_factory=list)
    """Numbers of the stored parts of its present attempt."""


@dataclass
class Held:
    """An attempt in the hands of a worker, present or past."""

    worker: int
    attempt: Attempt
    job_id: str


@dataclass
class Seat:
    """One worker: its side of the queue, and whether it is alive."""

    consumer: QueueConsumer
    holds: list[Held] = field(default_factory=list)


class JobMachine(RuleBasedStateMachine):
    url = ""
    folder = Path()

    def __init__(self) -> None:
        super().__init__()
        self.runner = asyncio.Runner()
        self.models: dict[str, Model] = {}
        self.keys: dict[str, tuple[str, int]] = {}
        self.past: list[Held] = []
        self.count = 0
        self.look = psycopg.connect(self.url, autocommit=True)
        self.do(self.open())

    def do(self, act: Any) -> Any:
        return self.runner.run(act)

    async def open(self) -> None:
        self.engine = make_engine(self.url, pool_size=2)
        self.store = JobStore(self.engine, KINDS, queue_limit=QUEUE_LIMIT)
        self.attempts = AttemptStore(self.engine, KINDS, max_attempts=MAX_ATTEMPTS)
        self.blobs = BlobStore.from_url(self.folder.as_uri())
        self.seats = [Seat(QueueConsumer(self.url)) for _ in range(2)]
        for seat in self.seats:
            await seat.consumer.send_heartbeat()

    def teardown(self) -> None:
        async def close() -> None:
            for seat in self.seats:
                await seat.consumer.close()
            await self.engine.dispose()

        self.do(close())
        self.runner.close()
        self.look.execute("TRUNCATE job, job_event, worker CASCADE")
        self.look.close()

    @initialize()
    def two_jobs_of_which_one_runs(self) -> None:
        self.submit_one(0, None, 0)
        self.submit_one(0, None, 1)
        self.take(0)

    # -- clients ----------------------------------------------------------------------------------------------------

    @rule(
        priority=st.sampled_from([0, 0, 5]),
        key=st.sampled_from([None, None, "k1", "k2"]),
        body=st.integers(0, 1),
    )
    def submit(self, priority: int, key: str | None, body: int) -> None:
        self.submit_one(priority, key, body)

    def submit_one(self, priority: int, key: str | None, body: int) -> None:
        waiting = sum(model.state == "queued" for model in self.models.values())
        try:
            submission = self.do(self.store.submit("work", {"n": body}, priority=priority, idempotency_key=key))
        except Busy:
            assert waiting >= QUEUE_LIMIT
            return
        except Conflict:
            assert key is not None
            assert self.keys[key][1] != body
            return
        if key is not None and key in self.keys:
            assert not submission.created
            assert self.keys[key] == (submission.job_id, body)
            return
        assert submission.created
        assert waiting < QUEUE_LIMIT
        self.count += 1
        self.models[submission.job_id] = Model(priority=priority, order=self.count)
        if key is not None:
            self.keys[key] = (submission.job_id, body)

    @rule(data=st.data())
    def cancel(self, data: Any) -> None:
        job_id = data.draw(st.sampled_from(sorted(self.models, key=lambda each: self.models[each].order)))
        self.do(self.store.request_cancel(job_id))
        model = self.models[job_id]
        if model.state == "queued":
            model.state, model.cancel_requested = "cancelled", True
        elif model.state == "running":
            model.cancel_requested = True

    # -- workers ----------------------------------------------------------------------------------------------------

    @rule(worker=st.integers(0, 1))
    def take(self, worker: int) -> None:
        seat = self.seats[worker]
        attempt = self.do(seat.consumer.claim_attempt(LANES))
        waiting = [(-m.priority, m.order, job_id) for job_id, m in self.models.items() if m.state == "queued"]
        if attempt is None:
            assert not waiting
            return
        assert min(waiting)[2] == attempt.job_id
        model = self.models[attempt.job_id]
        model.state, model.attempt, model.holder, model.carried = "running", model.attempt + 1, worker, True
        assert attempt.number == model.attempt
        seat.holds.append(Held(worker, attempt, attempt.job_id))

    def _present(self, held: Held) -> bool:
        model = self.models[held.job_id]
        return model.state == "running" and model.attempt == held.attempt.number

    def _ended_so(self, held: Held, state: str, error: str | None) -> bool:
        """This attempt has ended in this way already: saying so again, after a lost answer, is no contradiction."""
        model = self.models[held.job_id]
        return (model.state, model.error, model.attempt) == (state, error, held.attempt.number)

    def _choose(self, data: Any) -> Held | None:
        every = [held for seat in self.seats for held in seat.holds] + self.past
        return data.draw(st.sampled_from(every)) if every else None

    @rule(data=st.data(), fraction=st.floats(0, 1))
    def report(self, data: Any, fraction: float) -> None:
        held = self._choose(data)
        if held is not None:
            model = self.models[held.job_id]
            expected = self._present(held) and not model.cancel_requested
            number = 1 + max(model.parts, default=0)
            chunks = [(number, PART), (1, PART)]  # the first one again, as after a lost answer
            report = self.attempts.report_progress(held.attempt, fraction, "text\0with NUL", chunks)
            assert self.do(report) is expected
            if expected:
                model.parts = sorted({*model.parts, number})
            assert self.do(self.attempts.should_stop(held.attempt)) is not expected

    @rule(data=st.data())
    def succeed(self, data: Any) -> None:
        held = self._choose(data)
        if held is None:
            return
        model = self.models[held.job_id]
        may = self._present(held) and not model.cancel_requested
        already = model.state == "succeeded" and model.attempt == held.attempt.number
        published = self.do(self.attempts.publish_success(held.attempt, self.blobs, OUTCOME, [], self.folder, "log"))
        assert published is (may or already)
        if may:
            model.state = "succeeded"
        elif not already:
            # cancelled, or somebody else's by now: the worker ends what it can still end
            may, again = self._present(held), self._ended_so(held, "cancelled", None)
            assert self.do(self.attempts.end_attempt(held.attempt, "cancelled", None, "")) is (may or again)
            if may:
                model.state, model.error = "cancelled", None
        self._let_go(held)

    @rule(data=st.data(), state=st.sampled_from(["failed", "cancelled", "timed_out"]))
    def end(self, data: Any, state: Any) -> None:
        held = self._choose(data)
        if held is None:
            return
        problem = {"code": "c", "detail": "d", "errors": []}
        may, again = self._present(held), self._ended_so(held, state, "c")
        assert self.do(self.attempts.end_attempt(held.attempt, state, problem, "")) is (may or again)
        if may:
            self.models[held.job_id].state, self.models[held.job_id].error = state, "c"
        self._let_go(held)

    @rule(data=st.data())
    def hand_back(self, data: Any) -> None:
        held = self._choose(data)
        if held is None:
            return
        may = self._present(held)
        assert self.do(self.attempts.hand_back(held.attempt)) is may
        if may:
            model = self.models[held.job_id]
            model.state, model.holder, model.carried, model.parts = "queued", None, False, []
            model.returned += 1
        self._let_go(held)

    def _let_go(self, held: Held) -> None:
        """The worker is done with the attempt, whether or not it had a say."""
        self.seats[held.worker].consumer.release_attempt(held.attempt)
        self.seats[held.worker].holds = [h for h in self.seats[held.worker].holds if h is not held]
        self.past = [*(h for h in self.past if h is not held), held][-4:]  # it may try again

    @rule(worker=st.integers(0, 1))
    def stall(self, worker: int) -> None:
        """The worker is given up as dead, its jobs are queued again, the other one takes what is waiting."""
        self.given_up_as_dead(worker)
        self.reap()
        self.take(1 - worker)

    @rule(worker=st.integers(0, 1))
    def given_up_as_dead(self, worker: int) -> None:
        """Delete the worker's row; its attempts belong to a zombie from then on, which may act later."""
        seat = self.seats[worker]

        async def forget() -> None:
            await seat.consumer.unregister_worker()
            await seat.consumer.send_heartbeat()

        self.do(forget())
        for held in seat.holds:
            if self._present(held):
                self.models[held.job_id].carried = False
        self.past = [*self.past, *seat.holds][-4:]
        seat.holds = []

    @rule()
    def reap(self) -> None:
        lost = {job_id for job_id, m in self.models.items() if m.state == "running" and not m.carried}
        assert set(self.do(self.attempts.requeue_lost(None))) == lost
        for job_id in sorted(lost, key=lambda each: self.models[each].order):
            model = self.models[job_id]
            if model.cancel_requested:
                model.state = "cancelled"
            elif model.attempt - model.returned >= MAX_ATTEMPTS:
                model.state, model.error = "failed", "worker-died"
            else:
                model.state, model.holder, model.parts = "queued", None, []

    # -- what always holds ------------------------------------------------------------------------------------------

    @invariant()
    def rows_are_as_the_model_says(self) -> None:
        rows = self.look.execute(
            "SELECT id, state, attempt, result IS NOT NULL, finished_at IS NOT NULL FROM job"
        ).fetchall()
        assert {row[0] for row in rows} == set(self.models)
        for job_id, state, attempt, has_result, has_ended in rows:
            model = self.models[job_id]
            assert (state, attempt) == (model.state, model.attempt)
            assert has_result == (state == "succeeded")
            assert has_ended == (state in FINAL_STATES)

    @invariant()
    def only_running_attempts_have_parts(self) -> None:
        rows = self.look.execute("SELECT job_id, attempt, number FROM job_partial ORDER BY 1, 2, 3").fetchall()
        running = {job_id: m for job_id, m in sorted(self.models.items()) if m.state == "running"}
        assert rows == [(job_id, m.attempt, number) for job_id, m in running.items() for number in m.parts]

    @invariant()
    def events_tell_one_story(self) -> None:
        histories = self.look.execute(
            "SELECT job_id, array_agg(state ORDER BY seq), array_agg(attempt ORDER BY seq) FROM job_event GROUP BY 1"
        ).fetchall()
        assert {row[0] for row in histories} == set(self.models)
        for job_id, states, attempts in histories:
            assert states[-1] == self.models[job_id].state
            assert sum(state in FINAL_STATES for state in states) <= 1
            assert attempts == sorted(attempts)

    @invariant()
    def what_runs_has_a_worker_and_what_waits_has_none(self) -> None:
        """No accepted job is lost: queued jobs wait, running ones have a worker or will be requeued."""
        rows = self.look.execute("SELECT id, state, worker_id FROM job").fetchall()
        living = {number for (number,) in self.look.execute("SELECT id FROM worker")}
        for job_id, state, worker in rows:
            if state == "queued":
                assert worker is None
            if state == "running":
                assert (worker in living) is self.models[job_id].carried


@pytest.mark.timeout(600)
def test_random_sequences_of_calls_agree_with_the_model(database_url: str, tmp_path: Path) -> None:
    JobMachine.url, JobMachine.folder = database_url, tmp_path
    run_state_machine_as_test(
        JobMachine,
        settings=settings(
            max_examples=60,
            stateful_step_count=30,
            deadline=None,
            derandomize=True,
            suppress_health_check=list(HealthCheck),
        ),
    )
