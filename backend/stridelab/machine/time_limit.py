"""A limit of processor time beside one of elapsed time, so that a busy machine refuses no good file."""

import math
import time
from typing import Final

BUSY_FACTOR: Final = 6.0
"""Elapsed time, as a multiple of the limit of processor time, after which a reader is given up on a busy machine."""
_LOOK_S: Final = 0.05


class TimeLimit:
    """A process may use ``processor_s`` of processor time, and ``elapsed_s`` may pass, both from now on."""

    def __init__(self, pid: int, elapsed_s: float, processor_s: float = math.inf) -> None:
        self._pid, self._processor_s = pid, processor_s
        self._end_s = time.monotonic() + elapsed_s
        self._start_processor_s = _used_processor_s(pid)

    def wait_s(self) -> float:
        """Time in s for which the process cannot exceed its limits if it uses one core; 0 once it has."""
        left_s = self._end_s - time.monotonic()
        if self._processor_s < math.inf:
            processor_s = self._processor_s - (_used_processor_s(self._pid) - self._start_processor_s)
            left_s = min(left_s, 0.0 if processor_s <= 0.0 else max(processor_s, _LOOK_S))
        return max(0.0, left_s)


def _used_processor_s(pid: int) -> float:
    """Processor time of all threads of a process in s; 0 if it has ended, or where the system has no such clock.

    The clock is that of clock_getcpuclockid(3) in Linux. It needs no /proc, which sandboxes hide.
    """
    try:
        return time.clock_gettime((~pid << 3) | 2)
    except (OSError, OverflowError):
        return 0.0
