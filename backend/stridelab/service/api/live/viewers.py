"""Those who watch a live robot. They never delay it: a new frame replaces one that was not sent yet."""

import asyncio
from collections import deque
from typing import Final

MAX_WAITING: Final = 64
"""Messages other than frames that may wait for a slow viewer; then the oldest is dropped."""


class Viewer:
    """The messages of one viewer; ``may_push`` if its token permits to act on the robot."""

    def __init__(self, *, may_push: bool) -> None:
        self.may_push = may_push
        self._messages: deque[str] = deque(maxlen=MAX_WAITING)
        self._frame: str | None = None
        self._has_ended = False
        self._something = asyncio.Event()

    def show_frame(self, frame: str) -> None:
        """Show a frame instead of the one that waits."""
        self._frame = frame
        self._something.set()

    def send_message(self, message: str) -> None:
        """Send a message after those that wait."""
        self._messages.append(message)
        self._something.set()

    def end(self) -> None:
        """The session has ended; what waits is still sent."""
        self._has_ended = True
        self._something.set()

    async def next_message(self) -> str | None:
        """The next message, frames last; None at the end of the session."""
        while True:
            if self._messages:
                return self._messages.popleft()
            if self._frame is not None:
                frame, self._frame = self._frame, None
                return frame
            if self._has_ended:
                return None
            self._something.clear()
            await self._something.wait()
