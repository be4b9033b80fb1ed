"""Hanging processes are distinguished from starved ones; heartbeats pass through a pipe; hanging ones are replaced."""

import asyncio
import contextlib
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import psutil
import pytest

from stridelab.machine import heartbeat
from stridelab.service.processes import watchdog
from stridelab.service.processes.supervised_program import SupervisedProgram
from stridelab.service.processes.watchdog import CERTAIN_FACTOR, HUNG_S, STARTING_S, STOPPED_S, ResponseWatchdog

BEATING = """
import asyncio, sys, time
from stridelab.machine import heartbeat

async def main():
    task = asyncio.create_task(heartbeat.write_heartbeats())
    await asyncio.sleep(float(sys.argv[1]) if len(sys.argv) > 1 else 2.0)
    time.sleep(600)  # the event loop turns no more

asyncio.run(main())
"""


@pytest.fixture
def idle() -> Iterator[subprocess.Popen[bytes]]:
    """A process that waits."""
    process = subprocess.Popen([sys.executable, "-c", "import time; print(flush=True); time.sleep(600)"], stdout=-1)
    assert process.stdout is not None
    process.stdout.readline()
    yield process
    process.kill()
    process.wait()
    process.stdout.close()


class Clock:
    def __init__(self) -> None:
        self.now_s = 0.0

    def __call__(self) -> float:
        return self.now_s


def verdict_after(silence: ResponseWatchdog, clock: Clock, limit_s: float) -> tuple[str | None, float]:
    """First failure reported for a process that is checked five times a second, and when."""
    began_s = clock.now_s
    while clock.now_s - began_s < limit_s:
        clock.now_s += 0.2
        if (failure := silence.failure_state()) is not None:
            return failure, clock.now_s - began_s
    return None, limit_s


def test_a_process_that_waits_and_does_not_answer_hangs(idle: subprocess.Popen[bytes]) -> None:
    clock = Clock()
    silence = ResponseWatchdog(idle.pid, clock=clock)
    assert verdict_after(silence, clock, STARTING_S - 1) == (None, STARTING_S - 1)
    silence.record_answer()
    failure, after_s = verdict_after(silence, clock, 60.0)
    assert failure == "hangs"
    assert HUNG_S <= after_s < HUNG_S + 2
    silence.record_answer()
    assert silence.failure_state() is None


def test_a_stopped_process_is_detected_sooner_even_before_its_first_answer(idle: subprocess.Popen[bytes]) -> None:
    os.kill(idle.pid, signal.SIGSTOP)
    while psutil.Process(idle.pid).status() != psutil.STATUS_STOPPED:
        time.sleep(0.01)
    clock = Clock()
    failure, after_s = verdict_after(ResponseWatchdog(idle.pid, clock=clock), clock, 60.0)
    assert failure == "stopped"
    assert STOPPED_S <= after_s < STOPPED_S + 2


def test_a_process_that_waits_for_a_processor_has_more_time(
    idle: subprocess.Popen[bytes], monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = Clock()
    monkeypatch.setattr(watchdog, "queued_s", lambda _: 0.95 * clock.now_s)  # a twentieth of a processor
    silence = ResponseWatchdog(idle.pid, clock=clock)
    silence.record_answer()
    failure, after_s = verdict_after(silence, clock, 1000.0)
    assert failure == "hangs"
    assert HUNG_S * CERTAIN_FACTOR - 1 < after_s <= HUNG_S * CERTAIN_FACTOR + 1
    monkeypatch.setattr(watchdog, "queued_s", lambda _: 0.5 * clock.now_s)
    silence.record_answer()
    assert verdict_after(silence, clock, 1000.0)[1] == pytest.approx(2 * HUNG_S, abs=2.5)


def test_a_delayed_watchdog_ends_no_process(idle: subprocess.Popen[bytes]) -> None:
    clock = Clock()
    silence = ResponseWatchdog(idle.pid, clock=clock)
    silence.record_answer()
    clock.now_s += 3600.0
    assert silence.failure_state() is None


def test_time_on_the_run_queue_is_counted() -> None:
    spin = [sys.executable, "-c", "while True: pass"]
    cores = sorted(os.sched_getaffinity(0))[:1]
    crowd = [subprocess.Popen(["taskset", "-c", str(cores[0]), *spin]) for _ in range(3)]
    try:
        time.sleep(1.0)
        before_s, began_s = watchdog.queued_s(crowd[0].pid), time.monotonic()
        time.sleep(3.0)
        share = (watchdog.queued_s(crowd[0].pid) - before_s) / (time.monotonic() - began_s)
    finally:
        for process in crowd:
            process.kill()
            process.wait()
    assert 0.4 < share < 1.0, "three on one core: each waits for two thirds of the time, or longer"


def test_heartbeats_come_through_an_inherited_pipe_and_never_block(monkeypatch: pytest.MonkeyPatch) -> None:
    reading, writing = os.pipe()
    monkeypatch.setenv(heartbeat.VARIABLE, str(writing))
    monkeypatch.setattr(heartbeat, "PERIOD_S", 1e-5)

    async def some() -> None:
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(3.0):
                await heartbeat.write_heartbeats()

    asyncio.run(some())
    assert heartbeat.VARIABLE not in os.environ, "children do not inherit it"
    assert not os.get_inheritable(writing)
    assert set(os.read(reading, 1 << 16)) == set(b".")
    os.close(reading)
    monkeypatch.setenv(heartbeat.VARIABLE, str(writing))
    asyncio.run(heartbeat.write_heartbeats())  # the pipe has no reader: it returns
    os.close(writing)
    asyncio.run(heartbeat.write_heartbeats())  # no pipe was given


@pytest.mark.parametrize("how", ["stopped", "hangs"])
def test_a_program_without_heartbeats_is_started_again(
    how: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(watchdog, "STOPPED_S", 1.5)
    monkeypatch.setattr(watchdog, "HUNG_S", 2.0)
    (tmp_path / "beating.py").write_text(BEATING, encoding="utf-8")
    environment = {**os.environ, "PYTHONPATH": ":".join([str(tmp_path), *sys.path])}
    program = SupervisedProgram("beating", tmp_path / "x.log", environment)
    log_lines: list[str] = []
    program.keep_running(log_lines.append)
    assert program.process is not None
    assert program.watchdog is not None
    program.watchdog._hung_s = 2.0
    first = program.process.pid
    deadline = time.monotonic() + 60.0
    try:
        while (program.watchdog is None or not program.watchdog._has_answered) and time.monotonic() < deadline:
            program.keep_running(log_lines.append)
            time.sleep(0.05)
        if how == "stopped":
            program.process.send_signal(signal.SIGSTOP)
        while (program.process is None or program.process.pid == first) and time.monotonic() < deadline:
            program.keep_running(log_lines.append)
            time.sleep(0.1)
        assert log_lines == [f"beating {'is stopped' if how == 'stopped' else 'does not respond'}: restarting it."]
        assert program.process is not None
        assert program.process.pid != first
    finally:
        if program.process is not None:
            program.process.kill()
            program.process.wait()
        program._close_heartbeats()
