"""Open streams of markers of this process, and who watches them.

Those who watch never delay a stream: each has room for one picture, and a newer one replaces it.
"""

import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final

from stridelab.errors import Busy, NotFound
from stridelab.schemas.streams import LiveStream, MarkerStreamConfiguration
from stridelab.service.api.live.viewers import Viewer
from stridelab.service.api.stream.limits import RETRY_S

MAX_WATCHING: Final = 16
"""Those who can watch one stream at a time."""


class LiveChannel:
    """One open stream of markers."""

    def __init__(self, configuration: MarkerStreamConfiguration) -> None:
        self.stream_id = secrets.token_hex(8)
        self.configuration = configuration
        self.marker_set = ""
        self._watching: set[Viewer] = set()

    def describe(self) -> LiveStream:
        """The stream as a list shows it."""
        return LiveStream(
            stream_id=self.stream_id,
            title=self.configuration.title,
            marker_set=self.marker_set,
            rate_hz=self.configuration.rate_hz,
            n_watching=len(self._watching),
        )

    def publish(self, picture: str) -> None:
        """Show ``picture`` to all who watch."""
        for viewer in self._watching:
            viewer.show_frame(picture)

    def end_watching(self) -> None:
        """Tell all who watch that the stream has ended."""
        for viewer in self._watching:
            viewer.end()

    @contextmanager
    def watch(self) -> Iterator[Viewer]:
        """A viewer for the duration of the context. Raises ``Busy`` (``too-many-watching``)."""
        if len(self._watching) >= MAX_WATCHING:
            raise Busy(
                "too-many-watching", f"{MAX_WATCHING} others watch this stream already, which is the limit.", RETRY_S
            )
        viewer = Viewer(may_push=False)
        self._watching.add(viewer)
        try:
            yield viewer
        finally:
            self._watching.discard(viewer)


class LiveBoard:
    """The open streams of markers, the newest first."""

    def __init__(self) -> None:
        self._open: dict[str, LiveChannel] = {}

    @contextmanager
    def announce(self, channel: LiveChannel) -> Iterator[None]:
        """List ``channel`` for the duration of the context, and end the watching of it after that."""
        self._open[channel.stream_id] = channel
        try:
            yield
        finally:
            del self._open[channel.stream_id]
            channel.end_watching()

    def describe_all(self) -> list[LiveStream]:
        """All open streams, the newest first."""
        return [channel.describe() for channel in reversed(self._open.values())]

    def require_channel(self, stream_id: str) -> LiveChannel:
        """The open stream with this id. Raises ``NotFound`` (``stream-not-found``)."""
        channel = self._open.get(stream_id)
        if channel is None:
            raise NotFound("stream-not-found", "There is no open stream of markers with this id; it may have ended.")
        return channel
