"""Heartbeats: a process signals its parent that its event loop is running, with one byte in a pipe twice a second."""

import asyncio
import os
from typing import Final

VARIABLE: Final = "STRIDELAB_HEARTBEAT_FD"
"""Environment variable with the number of the inherited file descriptor to write to."""
PERIOD_S: Final = 0.5


async def write_heartbeats() -> None:
    """Write heartbeats until the task is cancelled; return at once if ``VARIABLE`` is not set."""
    number = os.environ.pop(VARIABLE, "")
    if not number.isdecimal():
        return
    pipe = int(number)
    os.set_inheritable(pipe, False)
    os.set_blocking(pipe, False)
    while True:
        try:
            os.write(pipe, b".")
        except BlockingIOError:
            pass  # the pipe is full of unread heartbeats
        except OSError:
            return  # the reader has ended
        await asyncio.sleep(PERIOD_S)
