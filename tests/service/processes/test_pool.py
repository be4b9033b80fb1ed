import asyncio
import os
import signal
import time
from collections.abc import Callable, Coroutine
from pathlib import Path
from typing import Any
from unittest import mock

import psutil
import pytest

from stridelab.errors import NotEstimable, StridelabError
from stridelab.service.kinds.registry import COMPUTING, READING
from stridelab.service.processes.pool import IsolatedPool
from stridelab.service.processes.running_child import LOG_TAIL_BYTES, IsolatedOutcome
from support.service.processes import is_over

Run = Callable[..., IsolatedOutcome]


def is_gone(pid: int) -> bool:
    """Whether a process has ended, or does so within 5 s."""
    began = time.monotonic()
    while not is_over(began, 5.0):
        try:
            if psutil.Process(pid).status() == psutil.STATUS_ZOMBIE:
                return True
        except psutil.NoSuchProcess:
            return True
        time.sleep(0.02)
    return False


@pytest.fixture
def with_pool(monkeypatch: pytest.MonkeyPatch) -> Callable[[Callable[[IsolatedPool], Coroutine[Any, Any, Any]]], Any]:
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parents[2]))

    def run(act: Callable[[IsolatedPool], Coroutine[Any, Any, Any]]) -> Any:
        async def inside() -> Any:
            async with IsolatedPool() as pool:
                return await act(pool)

        return asyncio.run(inside())

    return run


@pytest.fixture
def run(with_pool: Any, tmp_path: Path) -> Run:
    """One task in one child."""

    def once(function: str, task: dict[str, Any] | None = None, **options: Any) -> IsolatedOutcome:
        limits = {"timeout_s": 30.0, "memory_mb": 500, **options}
        return with_pool(
            lambda pool: pool.run(f"support.service.computations:{function}", task or {}, tmp_path, **limits)
        )

    return once


def test_value_progress_and_log_come_back(run: Run) -> None:
    heard: list[tuple[float, str]] = []
    outcome = run("add", {"a": 1, "b": 2}, on_progress=lambda fraction, message: heard.append((fraction, message)))
    assert outcome == IsolatedOutcome("ok", {"sum": 3}, None, None, "adding\n")
    assert heard == [(0.5, "half")]


def test_own_errors_keep_their_class_code_and_places(run: Run) -> None:
    outcome = run("refuse")
    assert outcome.state == "error"
    error = outcome.as_error()
    assert type(error) is NotEstimable
    assert (error.code, error.message) == ("no-plates", "The recording has no plates.")
    assert [(fault.where, fault.message) for fault in error.faults] == [("plates", "none")]


@pytest.mark.parametrize(
    ("function", "state", "code"),
    [
        ("stumble", "error", "computation-failed"),
        ("not_a_number", "error", "computation-failed"),
        ("no_such_function", "error", "computation-failed"),
        ("segfault", "crashed", "computation-crashed"),
        ("abort", "crashed", "computation-crashed"),
        ("leave", "crashed", "computation-crashed"),
        ("die_before_a_grandchild", "crashed", "computation-crashed"),
    ],
)
def test_other_ends_of_a_child_have_their_own_codes(run: Run, function: str, state: str, code: str) -> None:
    outcome = run(function)
    assert outcome.state == state
    assert outcome.problem is not None
    assert outcome.problem["code"] == code
    error = outcome.as_error()
    assert type(error) is StridelabError
    assert error.code == code


def test_reserving_too_much_memory_is_refused(run: Run) -> None:
    assert run("reserve", {"bytes": 400 << 20}).value == 400 << 20
    outcome = run("reserve", {"bytes": 4 << 30})
    assert outcome.state == "memory"
    assert outcome.as_error().code == "computation-out-of-memory"


def test_memory_of_children_counts(run: Run) -> None:
    # each stays below the limit of one process; together they do not
    outcome = run("hoard", memory_mb=250)
    assert outcome.state == "memory"
    assert "250 MB" in outcome.as_error().message


def test_memory_that_children_share_counts_once(run: Run) -> None:
    """Five processes see 150 MB, which are there once: 750 MB of resident pages."""
    outcome = run("share", memory_mb=300)
    assert (outcome.state, outcome.value) == ("ok", 150 << 20)


def test_a_computation_uses_the_cores_of_its_pool(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parents[2]))

    async def act() -> Any:
        async with IsolatedPool(cores=1) as pool:
            return await pool.run("support.service.computations:cores", {}, tmp_path, timeout_s=30.0, memory_mb=500)

    assert asyncio.run(act()).value == 1


def test_native_call_that_never_returns_times_out(run: Run) -> None:
    began = time.monotonic()
    outcome = run("hang", timeout_s=0.5)
    assert outcome.state == "timeout"
    assert "0.5 s" in outcome.as_error().message
    assert time.monotonic() - began < 20


def test_a_child_that_computes_beyond_its_processor_time_times_out(run: Run) -> None:
    outcome = run("compute_for_ever", timeout_s=300.0, processor_s=0.5)
    assert outcome.state == "timeout"
    assert "0.5 s" in outcome.as_error().message


def test_a_child_that_waits_longer_than_its_processor_time_is_not_ended(run: Run) -> None:
    assert run("wait_a_second", timeout_s=60.0, processor_s=0.5).state == "ok"


def test_cancelling_kills_the_child_and_what_it_started(with_pool: Any, tmp_path: Path) -> None:
    heard: list[str] = []

    async def act(pool: IsolatedPool) -> IsolatedOutcome:
        cancel = asyncio.Event()

        def note(_fraction: float, message: str) -> None:
            heard.append(message)
            cancel.set()

        return await pool.run(
            "support.service.computations:with_a_grandchild",
            {},
            tmp_path,
            timeout_s=60.0,
            memory_mb=500,
            cancel=cancel,
            on_progress=note,
        )

    assert with_pool(act).state == "cancelled"
    grandchild = int(heard[0].split()[1])
    assert is_gone(grandchild)


def test_cancelling_the_caller_kills_the_child(with_pool: Any, tmp_path: Path) -> None:
    pids: list[int] = []

    async def act(pool: IsolatedPool) -> None:
        task = asyncio.create_task(
            pool.run(
                "support.service.computations:spin",
                {},
                tmp_path,
                timeout_s=60.0,
                memory_mb=500,
                on_progress=lambda _fraction, message: pids.append(int(message.split()[1])),
            )
        )
        while not pids:
            await asyncio.sleep(0.02)
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task
        assert is_gone(pids[0])

    with_pool(act)


def test_a_long_log_is_cut_to_its_end(run: Run) -> None:
    outcome = run("chatter", {"bytes": 3_000_000})
    assert outcome.value == {"written": 3_000_000}
    assert len(outcome.log_tail) == LOG_TAIL_BYTES
    assert outcome.log_tail.endswith("last words\n")


def test_a_child_has_low_priority_and_no_secrets(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("STRIDELAB_API_TOKEN", "secret")
    monkeypatch.setenv("STRIDELAB_DATABASE_URL", "postgresql://secret")
    monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", "secret")
    monkeypatch.setenv("STRIDELAB_NATIVE_PATH", "a folder")
    child = run("environment").value
    assert [name for name in child["names"] if name.startswith(("STRIDELAB_", "AWS_"))] == ["STRIDELAB_NATIVE_PATH"]
    assert child["nice"] == min(19, os.nice(0) + 10)
    assert child["session"]
    assert child["cwd"]
    assert child["threads"] == "1"


def test_a_child_that_somebody_waits_for_keeps_its_rank(run: Run) -> None:
    assert run("environment", low_priority=False).value["nice"] == os.nice(0)


@pytest.mark.parametrize("niceness", [0, 3])
def test_the_niceness_of_the_children_is_that_of_the_pool(niceness: int, tmp_path: Path) -> None:
    async def one() -> IsolatedOutcome:
        async with IsolatedPool(niceness=niceness) as pool:
            return await pool.run(
                "support.service.computations:environment", {}, tmp_path, timeout_s=30.0, memory_mb=500
            )

    with mock.patch.dict(os.environ, {"PYTHONPATH": str(Path(__file__).parents[2])}):
        assert asyncio.run(one()).value["nice"] == min(19, os.nice(0) + niceness)


def test_every_task_has_a_child_of_its_own(with_pool: Any, tmp_path: Path) -> None:
    async def act(pool: IsolatedPool) -> list[IsolatedOutcome]:
        ask = {"timeout_s": 30.0, "memory_mb": 500}
        return await asyncio.gather(
            *(pool.run("support.service.computations:add", {"a": n, "b": 1}, tmp_path, **ask) for n in range(4)),
            pool.run("support.service.computations:segfault", {}, tmp_path, **ask),
        )

    outcomes = with_pool(act)
    assert [outcome.value for outcome in outcomes[:4]] == [{"sum": n + 1} for n in range(4)]
    assert outcomes[4].state == "crashed"


def test_no_process_of_the_children_remains(with_pool: Any, tmp_path: Path) -> None:
    before = 0

    async def act(pool: IsolatedPool) -> None:
        ask = {"timeout_s": 30.0, "memory_mb": 500}
        for function in ("add", "segfault", "leave"):
            await pool.run(f"support.service.computations:{function}", {"a": 1, "b": 1}, tmp_path, **ask)
        nursery = psutil.Process(pool._fork_server.pid)
        began = time.monotonic()
        while nursery.children():  # they are let go as soon as the nursery comes to it
            assert not is_over(began, 5.0)
            await asyncio.sleep(0.02)
        assert nursery.num_fds() == before

    async def counted(pool: IsolatedPool) -> None:
        nonlocal before
        await pool.run("support.service.computations:add", {"a": 1, "b": 1}, tmp_path, timeout_s=30.0, memory_mb=500)
        before = psutil.Process(pool._fork_server.pid).num_fds()
        await act(pool)

    with_pool(counted)


def test_a_dead_fork_server_is_replaced_and_its_children_count_as_killed(with_pool: Any, tmp_path: Path) -> None:
    ask: dict[str, Any] = {"timeout_s": 30.0, "memory_mb": 500}

    async def act(pool: IsolatedPool) -> tuple[IsolatedOutcome, IsolatedOutcome]:
        def kill(_fraction: float, _message: str) -> None:
            os.kill(pool._fork_server.pid, signal.SIGKILL)

        torn = await pool.run("support.service.computations:spin", {}, tmp_path, on_progress=kill, **ask)
        return torn, await pool.run("support.service.computations:add", {"a": 1, "b": 1}, tmp_path, **ask)

    torn, after = with_pool(act)
    assert torn.state == "killed"
    assert after.value == {"sum": 2}


def test_a_fork_server_that_died_unnoticed_is_replaced(with_pool: Any, tmp_path: Path) -> None:
    async def act(pool: IsolatedPool) -> IsolatedOutcome:
        os.kill(pool._fork_server.pid, signal.SIGKILL)
        time.sleep(0.2)  # the loop hears nothing of it
        return await pool.run(
            "support.service.computations:add", {"a": 1, "b": 1}, tmp_path, timeout_s=30.0, memory_mb=500
        )

    assert with_pool(act).value == {"sum": 2}


def test_a_fork_server_that_hangs_is_replaced_and_the_task_is_done(with_pool: Any, tmp_path: Path) -> None:
    ask: dict[str, Any] = {"timeout_s": 30.0, "memory_mb": 500}

    async def act(pool: IsolatedPool) -> tuple[IsolatedOutcome, int, int]:
        await pool.run("support.service.computations:add", {"a": 1, "b": 1}, tmp_path, **ask)
        hung = pool._fork_server.pid
        os.kill(hung, signal.SIGSTOP)
        async with asyncio.timeout(30.0):
            outcome = await pool.run("support.service.computations:add", {"a": 1, "b": 1}, tmp_path, **ask)
        return outcome, hung, pool._fork_server.pid

    outcome, hung, another = with_pool(act)
    assert (outcome.state, outcome.value) == ("ok", {"sum": 2})
    assert another != hung


def test_what_is_imported_ahead_is_there_and_starts_no_thread(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    # a lock that another thread holds at the fork would be held for ever in the child
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parents[2]))

    preload = {*READING, *COMPUTING}

    heard: list[str] = []

    async def inside() -> Any:
        async with IsolatedPool(sorted(preload)) as pool:
            task = {"modules": sorted(preload), "needless": ["sqlalchemy", "trimesh", "sklearn"]}
            ask: dict[str, Any] = {"timeout_s": 60.0, "memory_mb": 500, "sandbox": None}  # it looks at its parent
            ask["on_progress"] = lambda _fraction, text: heard.append(text)
            return (await pool.run("support.service.computations:inheritance", task, tmp_path, **ask)).value

    inheritance = asyncio.run(inside())
    assert heard == ["start: waiting for the libraries"]  # the first task of a process that has just been started
    assert inheritance == {"missing": [], "needless": [], "threads_of_the_nursery": 1}
