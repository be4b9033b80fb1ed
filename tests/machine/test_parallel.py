"""Several processes answer as one does, in order; nothing of them is left however it ends."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import closing, nullcontext
from pathlib import Path

import psutil
import pytest

from stridelab.errors import NotEstimable, StorageFull
from stridelab.machine.cores import limit_cores, usable_cores
from stridelab.machine.parallel import PROCESSES_MAX, WorkBeside, compute_beside, map_in_order, worthwhile_processes
from support import parallel_work
from support.parallel_work import another_thread, workers

WAIT_S = 30.0


@pytest.fixture(params=["one thread", "two threads"], autouse=True)
def threads(request: pytest.FixtureRequest) -> Iterator[str]:
    """A process with one thread forks itself; one with more asks a server."""
    with another_thread() if request.param == "two threads" else nullcontext():
        yield request.param


def until(true: Callable[[], bool]) -> bool:
    end = time.monotonic() + WAIT_S
    while not true() and time.monotonic() < end:
        time.sleep(0.05)
    return true()


@pytest.mark.parametrize("processes", [1, 2, 3])
def test_answers_come_in_the_order_of_the_pieces(processes: int) -> None:
    answers = list(map_in_order(parallel_work.square, 5, processes))
    assert [square for square, _ in answers] == [0, 1, 4, 9, 16]
    by = {pid for _, pid in answers}
    assert by == {os.getpid()} if processes == 1 else len(by) == processes and os.getpid() not in by
    assert workers() == []


def test_there_are_no_more_processes_than_pieces() -> None:
    ((_, pid),) = map_in_order(parallel_work.square, 1, 4)
    assert pid == os.getpid()
    assert list(map_in_order(parallel_work.square, 0, 4)) == []


@pytest.mark.parametrize("processes", [1, 2])
def test_libraries_keep_to_one_thread(processes: int) -> None:
    """With more, sums may depend on how many there are."""
    for counts in map_in_order(parallel_work.threads, 2, processes):
        assert counts
        assert set(counts) == {1}


def test_an_error_of_a_process_is_raised_unchanged() -> None:
    answers = map_in_order(parallel_work.refuse, 4, 2)
    assert [next(answers), next(answers)] == [0, 1]
    with pytest.raises(NotEstimable) as refusal:
        next(answers)
    assert (refusal.value.code, refusal.value.faults[0].where) == ("no-posture", "robot")
    assert workers() == []


def test_a_process_out_of_memory_is_reported_as_such() -> None:
    """So that a job says that it needed more memory than its limit."""
    with pytest.raises(MemoryError):
        list(map_in_order(parallel_work.hog, 2, 2))


def test_a_full_disk_is_named() -> None:
    """So that a job says that its files could not be written, and not only that a process ended."""
    with pytest.raises(StorageFull) as refusal:
        list(map_in_order(parallel_work.fill_disk, 2, 2))
    assert refusal.value.code == "scratch-full"


def test_a_process_that_vanishes_is_noticed() -> None:
    with pytest.raises(NotEstimable) as refusal:
        list(map_in_order(parallel_work.vanish, 2, 2))
    assert refusal.value.code == "process-ended"


def test_a_closed_iterator_leaves_no_process() -> None:
    with closing(map_in_order(parallel_work.hang, 4, 2)) as answers:
        assert len({next(answers), next(answers)}) == 2
        assert len(workers()) == 2
    assert workers() == []


def test_processes_end_with_a_killed_parent(tmp_path: Path, threads: str) -> None:
    environment = {
        **os.environ,
        "NOTED": str(tmp_path),
        "THREADS": threads,
        "PYTHONPATH": str(Path(__file__).parents[1]),
    }
    parent = subprocess.Popen([sys.executable, "-m", "support.parallel_work"], env=environment)
    try:
        assert until(lambda: len(list(tmp_path.iterdir())) == 2)
        children = [int(path.name) for path in tmp_path.iterdir()]
        assert all(psutil.pid_exists(pid) for pid in children)
    finally:
        parent.send_signal(signal.SIGKILL)
        parent.wait()
    assert until(lambda: not any(psutil.pid_exists(pid) for pid in children))


def test_the_number_of_worthwhile_processes_is_limited() -> None:
    assert worthwhile_processes(0) == worthwhile_processes(1) == 1
    assert worthwhile_processes(1000) == min(usable_cores(), PROCESSES_MAX)


def test_work_beside_has_its_own_process_if_there_are_one_thread_and_two_cores(threads: str) -> None:
    assert threads == "one thread" or not WorkBeside.is_possible()
    forks = WorkBeside.is_possible() and usable_cores() > 1  # tests before this one may have left a thread
    with compute_beside(lambda: parallel_work.square(7)) as wait:
        assert len(workers()) == int(forks)
        square, process = wait()
    assert square == 49
    assert (process != os.getpid()) == forks
    assert workers() == []


def test_work_beside_on_one_core_runs_when_it_is_waited_for() -> None:
    done: list[int] = []
    limit_cores(1)
    try:
        with compute_beside(lambda: done.append(1)) as wait:
            assert done == []
            wait()
    finally:
        limit_cores(None)
    assert done == [1]


def test_an_error_of_work_beside_is_raised_where_it_is_waited_for() -> None:
    with compute_beside(lambda: parallel_work.refuse(2)) as wait, pytest.raises(NotEstimable) as refused:
        wait()
    assert refused.value.code == "no-posture"


def test_work_beside_ends_with_its_context() -> None:
    with compute_beside(lambda: parallel_work.hang(2)):
        pass
    assert workers() == []
