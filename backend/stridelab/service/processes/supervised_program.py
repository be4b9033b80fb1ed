"""A program that the supervisor starts, watches and restarts."""

import contextlib
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import psutil

from stridelab.machine import heartbeat
from stridelab.service.processes.parent_death import command_ending_with_parent
from stridelab.service.processes.watchdog import ResponseWatchdog, queued_s

FAILURES: Final = {"stopped": "is stopped", "hangs": "does not respond"}
"""What a watchdog has noticed, in words."""
_BACKOFF_S: Final = (0.2, 0.5, 1.0, 2.0, 5.0, 10.0)
_STABLE_AFTER_S: Final = 30.0
_MAX_LOG_BYTES: Final = 5_000_000
_OLD_LOGS: Final = (".log.old", *(f".log.old.{k}" for k in range(2, 6)))
_USE_PERIOD_S: Final = 5.0


@dataclass
class SupervisedProgram:
    """A program whose restart delay grows with consecutive ``failures``; without ``log`` it shares our output.

    It runs while ``is_wanted``.
    """

    module: str
    log: Path | None
    environment: Mapping[str, str]
    before_restart: Callable[[], None] = lambda: None
    is_wanted: Callable[[], bool] = lambda: True
    process: subprocess.Popen[bytes] | None = None
    started_at_s: float = 0.0
    failures: int = 0
    next_start_s: float = field(default=0.0)
    heartbeats: int | None = None
    watchdog: ResponseWatchdog | None = None

    def keep_running(self, print_line: Callable[[str], None] = lambda _: None) -> None:
        """Restart it after its delay if it has exited; kill it, and ``print_line`` so, if it does not respond."""
        now = time.monotonic()
        self._trim_log()
        if self.process is not None:
            if self.process.poll() is None:
                if not self.is_wanted():
                    self.process.terminate()
                self._kill_if_unresponsive(self.process, print_line)
                return
            self._close_heartbeats()
            self.failures = 0 if now - self.started_at_s > _STABLE_AFTER_S else self.failures + 1
            self.next_start_s = now + _BACKOFF_S[min(self.failures, len(_BACKOFF_S) - 1)]
            self.process = None
            self.before_restart()
        if now >= self.next_start_s and self.is_wanted():
            self._start_process(now)

    def _start_process(self, now_s: float) -> None:
        self.heartbeats, theirs = os.pipe()
        os.set_blocking(self.heartbeats, False)
        # append mode, so that the file may be truncated while the program writes
        with os.fdopen(theirs, "wb"), self.log.open("ab") if self.log else contextlib.nullcontext() as log:
            self.process = subprocess.Popen(
                command_ending_with_parent([sys.executable, "-m", self.module]),
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
                env={**self.environment, heartbeat.VARIABLE: str(theirs)},
                pass_fds=[theirs],
                start_new_session=True,  # the terminal's Ctrl-C is for the supervisor alone
            )
        self.watchdog = ResponseWatchdog(self.process.pid)
        self.started_at_s = now_s

    def _kill_if_unresponsive(self, process: "subprocess.Popen[bytes]", print_line: Callable[[str], None]) -> None:
        if self.heartbeats is None or self.watchdog is None:
            return
        with contextlib.suppress(BlockingIOError):
            if os.read(self.heartbeats, 1 << 16):
                self.watchdog.record_answer()
                return
        verdict = self.watchdog.failure_state()
        if verdict is not None:
            print_line(f"{self.module} {FAILURES[verdict]}: restarting it.")
            process.kill()

    def _close_heartbeats(self) -> None:
        if self.heartbeats is not None:
            os.close(self.heartbeats)
        self.heartbeats = self.watchdog = None

    def _trim_log(self) -> None:
        """Rotate the log when it exceeds its size limit; a line written during the rotation may be lost."""
        if self.log and self.log.exists() and self.log.stat().st_size > _MAX_LOG_BYTES:
            older = [self.log.with_suffix(suffix) for suffix in _OLD_LOGS]
            for newer, older_one in zip(older[-2::-1], older[:0:-1], strict=True):
                if newer.exists():
                    newer.replace(older_one)
            shutil.copyfile(self.log, older[0])
            os.truncate(self.log, 0)

    def send_signal(self, signum: int) -> None:
        """Send a signal if the program runs."""
        if self.process is not None and self.process.poll() is None:
            self.process.send_signal(signum)

    def last_log_line(self) -> str:
        """The last line of its log."""
        if self.log is None:
            return "see its output above"
        text = self.log.read_text(encoding="utf-8", errors="replace").strip() if self.log.exists() else ""
        return f"{text.splitlines()[-1][-300:] if text else 'its log is empty'} (more in {self.log})"


@dataclass
class BusySignal:
    """Whether ``program`` needs help: from a share ``above`` of a processor until ``rest_s`` with less than ``below``.

    A share is that of the time in which it uses a processor or waits for one, over five seconds, in which the imports
    of a program that starts are no load.
    """

    program: SupervisedProgram
    above: float
    below: float
    rest_s: float
    clock: Callable[[], float] = time.monotonic
    _busy_until_s: float = float("-inf")
    _measured: tuple[int, float, float] | None = None

    def is_busy(self) -> bool:
        """Measure if it is time to, and return whether the program is busy."""
        now_s, process = self.clock(), self.program.process
        if process is not None and (self._measured is None or now_s - self._measured[1] >= _USE_PERIOD_S):
            with contextlib.suppress(psutil.Error):
                times = psutil.Process(process.pid).cpu_times()
                measured = process.pid, now_s, times.user + times.system + queued_s(process.pid)
                if self._measured is not None and self._measured[0] == process.pid:
                    share = (measured[2] - self._measured[2]) / (now_s - self._measured[1])
                    if share >= (self.below if now_s < self._busy_until_s else self.above):
                        self._busy_until_s = now_s + self.rest_s
                self._measured = measured
        return now_s < self._busy_until_s
