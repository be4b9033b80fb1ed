"""Limits of processor time and of elapsed time, on processes that compute, sleep, are held up, or have ended."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator

import pytest

from stridelab.machine.time_limit import TimeLimit

COMPUTE = "while True: pass"
SLEEP = "import time; time.sleep(600)"
Start = Callable[[str], int]


@pytest.fixture
def start_process() -> Iterator[Start]:
    """``start_process(program)``: the id of a Python process, which is killed at the end of the test."""
    started: list[subprocess.Popen[bytes]] = []

    def start(program: str) -> int:
        process = subprocess.Popen([sys.executable, "-c", f"print(flush=True)\n{program}"], stdout=subprocess.PIPE)
        started.append(process)
        assert process.stdout is not None
        process.stdout.readline()  # so that its start is not counted
        return process.pid

    yield start
    for process in started:
        process.kill()
        process.communicate()


def elapsed_until_reached_s(limit: TimeLimit) -> float:
    start_s = time.monotonic()
    while wait_s := limit.wait_s():
        time.sleep(wait_s)
    return time.monotonic() - start_s


def test_a_process_that_computes_reaches_its_processor_time(start_process: Start) -> None:
    limit = TimeLimit(start_process(COMPUTE), elapsed_s=120.0, processor_s=0.3)
    assert 0.3 <= elapsed_until_reached_s(limit) < 60.0


def test_a_process_that_waits_is_given_the_elapsed_time(start_process: Start) -> None:
    limit = TimeLimit(start_process(SLEEP), elapsed_s=0.6, processor_s=0.1)
    assert elapsed_until_reached_s(limit) >= 0.6


def test_a_process_without_a_core_does_not_use_its_processor_time(start_process: Start) -> None:
    pid = start_process(COMPUTE)
    limit = TimeLimit(pid, elapsed_s=120.0, processor_s=0.4)
    os.kill(pid, signal.SIGSTOP)
    time.sleep(0.8)
    assert limit.wait_s() > 0.0
    os.kill(pid, signal.SIGCONT)
    assert elapsed_until_reached_s(limit) < 60.0


def test_elapsed_time_alone(start_process: Start) -> None:
    limit = TimeLimit(start_process(COMPUTE), elapsed_s=0.2)
    assert 0.0 < limit.wait_s() <= 0.2
    assert elapsed_until_reached_s(limit) >= 0.15


def test_a_process_that_has_ended_uses_nothing() -> None:
    process = subprocess.Popen([sys.executable, "-c", ""])
    process.wait()
    assert TimeLimit(process.pid, elapsed_s=5.0, processor_s=1.0).wait_s() == pytest.approx(1.0)
