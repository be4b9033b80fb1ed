"""Computations yield to the web server, the database and whoever else uses the machine.

Where Linux groups processes by session (``sched_autogroup_enabled``, usual on desktops), niceness counts within a
session only, and between sessions that of the group does. Every child leads a session of its own, so it needs both.
"""

import os
import time
from pathlib import Path
from typing import Final

NICENESS: Final = 10
_GROUP: Final = Path("/proc/self/autogroup")
_AGAIN_S: Final = (0.05, 0.1, 0.2, 0.4)
"""The kernel takes ten such changes per second from all users together; after that, it is done without."""


def yield_processor(niceness: int = NICENESS) -> None:
    """Make this process nicer by ``niceness``, and its session, which it must lead."""
    os.nice(niceness)
    yield_session(niceness)


def yield_session(niceness: int = NICENESS, group: Path = _GROUP) -> None:
    """Make this process' session nicer; for one that was forked from a nice process and has begun its own."""
    for pause_s in _AGAIN_S:
        try:
            group.write_text(str(niceness), encoding="ascii")
        except BlockingIOError:
            time.sleep(pause_s)
        except OSError:
            return  # no such groups here, or not ours to change
        else:
            return
