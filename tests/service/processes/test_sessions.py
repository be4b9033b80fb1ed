"""One child for many tasks: it keeps its state, and ends with its client, without memory, or when idle."""

import asyncio
import os
import signal
import time
from collections.abc import Callable, Coroutine
from pathlib import Path
from typing import Any

import psutil
import pytest

from stridelab.errors import NotEstimable
from stridelab.service.processes.pool import ChildSession, IsolatedPool
from stridelab.service.processes.priority import LIVE_NICENESS

COUNTER = "support.service.computations:Counter"
Act = Callable[[ChildSession], Coroutine[Any, Any, Any]]


@pytest.fixture
def with_session(monkeypatch: pytest.MonkeyPatch) -> Callable[..., Any]:
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parents[2]))

    def run(act: Act, **options: Any) -> Any:
        async def inside() -> Any:
            async with IsolatedPool() as pool, pool.open_session(COUNTER, memory_mb=200, **options) as session:
                return await act(session)

        return asyncio.run(inside())

    return run


async def ended(session: ChildSession) -> bool:
    until = time.monotonic() + 20
    while not session.has_ended and time.monotonic() < until:
        await asyncio.sleep(0.05)
    return session.has_ended and session.pid is None


def test_tasks_share_the_state_of_one_child_and_errors_do_not_end_it(with_session: Any) -> None:
    async def act(session: ChildSession) -> None:
        first = await session.run({})
        refused = await session.run({"how": "refuse"})
        broken = await session.run({"how": "stumble"})
        fourth = await session.run({})
        assert (first.value["count"], fourth.value["count"]) == (1, 4)
        assert first.value["pid"] == fourth.value["pid"] == session.pid
        assert (broken.state, broken.error_class) == ("error", None)
        error = refused.as_error()
        assert (type(error), error.code, error.faults[0].where) == (NotEstimable, "no-plates", "plates")

    with_session(act)


@pytest.mark.parametrize(
    ("task", "state"),
    [({"how": "hoard", "bytes": 1 << 30}, "memory"), ({"how": "abort"}, "crashed")],
)
def test_after_a_crash_or_without_memory_the_child_is_gone(with_session: Any, task: Any, state: str) -> None:
    async def act(session: ChildSession) -> None:
        await session.run({})
        outcome = await session.run(task)
        assert (outcome.state, outcome.error_class) == (state, None)
        assert await ended(session)
        assert (await session.run({})).state == state

    with_session(act)


def test_a_task_that_takes_too_long_kills_the_child(with_session: Any) -> None:
    async def act(session: ChildSession) -> None:
        await session.run({})
        assert (await session.run({"wait_s": 60.0})).state == "timeout"
        assert await ended(session)

    with_session(act, answer_s=0.3)


def test_the_answer_to_a_task_that_was_given_up_is_not_taken_for_the_next(with_session: Any) -> None:
    async def act(session: ChildSession) -> None:
        await session.run({})
        given_up = asyncio.create_task(session.run({"wait_s": 0.3}))
        await asyncio.sleep(0.1)
        given_up.cancel()
        with pytest.raises(asyncio.CancelledError):
            await given_up
        assert (await session.run({})).value["count"] == 3

    with_session(act)


def test_a_child_without_tasks_ends_by_itself(with_session: Any) -> None:
    async def act(session: ChildSession) -> None:
        await session.run({})
        assert await ended(session)

    with_session(act, idle_s=1)


def test_closing_the_session_kills_the_child(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parents[2]))

    async def inside() -> None:
        async with IsolatedPool() as pool:
            async with pool.open_session(COUNTER, memory_mb=200) as session:
                pid = (await session.run({})).value["pid"]
                assert psutil.pid_exists(pid)
            until = time.monotonic() + 20
            while psutil.pid_exists(pid) and time.monotonic() < until:
                await asyncio.sleep(0.05)
            assert not psutil.pid_exists(pid)

    asyncio.run(inside())


@pytest.mark.parametrize("live", [False, True])
def test_a_live_child_precedes_others_where_the_system_permits_it(with_session: Any, live: bool) -> None:
    async def act(session: ChildSession) -> int:
        await session.run({})
        return psutil.Process(session.pid).nice()

    own = os.nice(0)
    permitted = os.geteuid() == 0
    assert with_session(act, live=live) == (LIVE_NICENESS if live and permitted else own)


def test_a_child_killed_with_an_unread_task_counts_as_killed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its connection is reset, here a second before the fork server reports its end."""
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parents[2]))

    async def killed() -> str:
        async with IsolatedPool() as pool, pool.open_session(COUNTER, memory_mb=200) as session:
            await session.run({})
            child, server = session.pid, pool._fork_server.pid
            os.kill(child, signal.SIGSTOP)
            running = asyncio.create_task(session.run({}))
            await asyncio.sleep(0.3)  # the task is sent
            os.kill(server, signal.SIGSTOP)
            os.kill(child, signal.SIGKILL)
            await asyncio.sleep(1.0)
            assert not running.done()
            os.kill(server, signal.SIGCONT)
            return (await running).state

    assert asyncio.run(killed()) == "killed"


def test_a_child_that_closes_its_connection_and_runs_on_is_ended(
    with_session: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("stridelab.service.processes.running_child._END_TIMEOUT_S", 1.0)

    async def act(session: ChildSession) -> str:
        await session.run({})
        async with asyncio.timeout(20.0):
            outcome = await session.run({"how": "disconnect"})
        assert await ended(session)
        return outcome.state

    assert with_session(act) == "crashed"
