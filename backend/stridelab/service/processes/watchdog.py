"""Distinguishes a hanging process from one that is waiting for the processor.

Silence counts only while the process could have answered: not while its threads wait on a run queue (second field of
``/proc/<pid>/task/<tid>/schedstat``, in ns: Linux Documentation/scheduler/sched-stats), while it waits for a disk, or
while the watching process is itself delayed. A process stopped by a signal (SIGSTOP) is detected sooner. A process
under a debugger is ignored.
"""

import time
from collections.abc import Callable
from pathlib import Path
from typing import Final, Literal

import psutil

STOPPED_S: Final = 3.0
HUNG_S: Final = 8.0
STARTING_S: Final = 120.0
"""Limit before the first answer, which includes the import of libraries."""
CERTAIN_FACTOR: Final = 8.0
"""Multiple of the limit after which a process counts as hanging whatever it waits for."""
_MIN_SILENCE_S: Final = 1.0
_MAX_GAP_S: Final = 1.0
"""Maximum time that is counted between two checks."""

FailureState = Literal["stopped", "hangs"]


class ResponseWatchdog:
    """Measures how long a process has not answered.

    Call ``record_answer`` for each answer and ``failure_state`` regularly.
    """

    def __init__(self, pid: int, *, hung_s: float = HUNG_S, clock: Callable[[], float] = time.monotonic) -> None:
        self._pid, self._hung_s, self._clock = pid, hung_s, clock
        self._looked_at_s = clock()
        self._has_answered = False
        self._passed_s = self._silent_s = self._stopped_s = 0.0
        self._queued_s: float | None = None

    def record_answer(self) -> None:
        """Record an answer."""
        self._has_answered = True
        self._looked_at_s = self._clock()
        self._reset_times()

    def failure_state(self) -> FailureState | None:
        """State of the process; None while it counts as responsive."""
        now_s = self._clock()
        passed_s = min(now_s - self._looked_at_s, _MAX_GAP_S)
        self._looked_at_s = now_s
        self._passed_s += passed_s
        if self._passed_s < _MIN_SILENCE_S:
            return None
        try:
            status = psutil.Process(self._pid).status()
        except psutil.Error:
            return None  # it has ended, which its parent detects itself
        if status == psutil.STATUS_TRACING_STOP:
            self._reset_times()
            return None
        queued_now_s = queued_s(self._pid)
        waited_s = max(queued_now_s - self._queued_s, 0.0) if self._queued_s is not None else passed_s
        self._queued_s = queued_now_s
        self._stopped_s = self._stopped_s + passed_s if status == psutil.STATUS_STOPPED else 0.0
        if status != psutil.STATUS_DISK_SLEEP:
            self._silent_s += max(passed_s - waited_s, 0.0)
        limit_s = self._hung_s if self._has_answered else max(STARTING_S, self._hung_s)
        if self._stopped_s > STOPPED_S:
            return "stopped"
        return "hangs" if self._silent_s > limit_s or self._passed_s > CERTAIN_FACTOR * limit_s else None

    def _reset_times(self) -> None:
        self._passed_s = self._silent_s = self._stopped_s = 0.0
        self._queued_s = None


def queued_s(pid: int) -> float:
    """Total time in seconds that all threads of a process have waited for a processor; 0 if not available."""
    total_ns = 0
    try:
        threads = list(Path(f"/proc/{pid}/task").iterdir())
    except OSError:
        return 0.0
    for thread in threads:
        try:
            total_ns += int((thread / "schedstat").read_bytes().split()[1])
        except (OSError, ValueError, IndexError):
            continue  # the thread has ended, or the kernel has no such file
    return 1e-9 * total_ns
