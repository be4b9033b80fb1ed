"""Lowers the priority of computations below the web server, the database and other users of the machine.

Where Linux groups processes by session (``sched_autogroup_enabled``, usual on desktops), niceness has an effect within
a session only; between sessions the niceness of the group counts. Every child leads its own session and needs both.
"""

import contextlib
import os
import time
from pathlib import Path
from typing import Final

NICENESS: Final = 10
LIVE_NICENESS: Final = -10
"""Niceness of a child that must answer in time, where the system permits it (root, or ``CAP_SYS_NICE``)."""
_AUTOGROUP_FILE: Final = Path("/proc/self/autogroup")
_RETRY_PAUSES_S: Final = (0.05, 0.1, 0.2, 0.4)
"""Pauses between retries: the kernel accepts ten such changes per second from all users together."""


def lower_priority(niceness: int = NICENESS) -> None:
    """Raise the niceness of this process and of its session, which it must lead."""
    os.nice(niceness)
    lower_session_priority(niceness)


def raise_priority(niceness: int = LIVE_NICENESS) -> None:
    """Lower the niceness of this process and of its session, which it must lead; unchanged without permission."""
    with contextlib.suppress(OSError):
        os.setpriority(os.PRIO_PROCESS, 0, niceness)
        lower_session_priority(niceness)


def lower_session_priority(niceness: int = NICENESS, group: Path = _AUTOGROUP_FILE) -> None:
    """Raise the niceness of this process's session; for a session leader forked from a process with niceness."""
    for pause_s in _RETRY_PAUSES_S:
        try:
            group.write_text(str(niceness), encoding="ascii")
        except BlockingIOError:
            time.sleep(pause_s)
        except OSError:
            return  # no such groups, or no permission
        else:
            return
