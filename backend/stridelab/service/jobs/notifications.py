"""Notifications of job changes: one LISTEN connection wakes event streams, long polls and workers.

A notification only announces a change; the state is read from the tables. A lost notification therefore causes a delay
and no wrong state: all watchers read again after every reconnection and at least every ``FALLBACK_S``.
"""

import asyncio
import contextlib
from collections import deque
from collections.abc import AsyncGenerator, Callable, Iterator, Sequence
from typing import Final, Self

import psycopg
import structlog
from psycopg import sql

from stridelab.schemas.jobs import JobEvent
from stridelab.service.jobs.events import CHANNEL
from stridelab.service.jobs.store import JobRecord, JobStore
from stridelab.service.storage.database import CONNECTION_OPTIONS, libpq_url

FALLBACK_S: Final = 15.0
"""Polling interval without notifications."""
RECENT_EVENTS: Final = 1000
"""Number of events of a job in memory for its listeners."""
_RECONNECT_S: Final = (0.1, 0.2, 0.5, 1.0, 2.0)
_log = structlog.get_logger(__name__)


class Listener:
    """Asynchronous context manager: a connection that listens on ``channels`` and reconnects after failures.

    ``on_notify(channel, payload)`` is called in the event loop; ``on_gap()`` whenever notifications may have been
    missed.
    """

    def __init__(
        self,
        url: str,
        channels: Sequence[str],
        on_notify: Callable[[str, str], None],
        on_gap: Callable[[], None],
    ) -> None:
        self._url, self._channels = url, tuple(channels)
        self._on_notify, self._on_gap = on_notify, on_gap
        self._task: asyncio.Task[None] | None = None
        self.listening = asyncio.Event()
        """Set while the connection is open."""

    async def __aenter__(self) -> Self:
        self._task = asyncio.get_running_loop().create_task(self._listen_and_reconnect())
        return self

    async def __aexit__(self, *_: object) -> None:
        if self._task is not None:
            self._task.cancel()
            await asyncio.gather(self._task, return_exceptions=True)

    async def _listen_and_reconnect(self) -> None:
        failures = 0
        while True:
            try:
                async with await psycopg.AsyncConnection.connect(
                    libpq_url(self._url), autocommit=True, application_name="stridelab-listen", **CONNECTION_OPTIONS
                ) as connection:
                    for channel in self._channels:
                        await connection.execute(sql.SQL("LISTEN {}").format(sql.Identifier(channel)))
                    failures = 0
                    self.listening.set()
                    await self._dispatch_notifications(connection)
            except psycopg.Error as error:
                _log.warning("listening-interrupted", error=type(error).__name__)
            finally:
                self.listening.clear()
            await asyncio.sleep(_RECONNECT_S[min(failures, len(_RECONNECT_S) - 1)])
            failures += 1

    async def _dispatch_notifications(self, connection: psycopg.AsyncConnection) -> None:
        while True:
            self._on_gap()
            async for notification in connection.notifies(timeout=FALLBACK_S):
                self._on_notify(notification.channel, notification.payload)
            await connection.execute("SELECT 1")  # detects a connection that died silently


class JobNotifications:
    """Asynchronous context manager that wakes the watchers of a job; one per process."""

    def __init__(self, url: str) -> None:
        self._watchers: dict[str, set[asyncio.Event]] = {}
        self._feeds: dict[str, _JobFeed] = {}
        self._listener = Listener(url, [CHANNEL], self._wake_watchers, self._wake_all)

    async def __aenter__(self) -> Self:
        await self._listener.__aenter__()
        return self

    async def __aexit__(self, *error: object) -> None:
        await self._listener.__aexit__(*error)

    @contextlib.contextmanager
    def watch_job(self, job_id: str) -> Iterator[asyncio.Event]:
        """An event that is set whenever the job may have changed; clear it *before* reading the tables."""
        event = asyncio.Event()
        self._watchers.setdefault(job_id, set()).add(event)
        try:
            yield event
        finally:
            self._watchers[job_id].discard(event)
            if not self._watchers[job_id]:
                del self._watchers[job_id]

    async def follow_events(
        self, store: JobStore, job_id: str, after: int = 0, closing: asyncio.Event | None = None
    ) -> AsyncGenerator[tuple[JobEvent, ...], None]:
        """The job's events after number ``after``, as they are written, until the job has ended or ``closing`` is set.

        All listeners to a job share one reader of the tables; who joins late, or is slow, reads what it missed itself.
        Yields an empty tuple after ``FALLBACK_S`` without events (as a keep-alive). Raises ``NotFound``.
        """
        feed = self._feeds.get(job_id)
        if feed is None:
            feed = self._feeds[job_id] = _JobFeed(job_id, after)
            feed.start_reading(self, store, closing)
        feed.listeners += 1
        try:
            while True:
                change = feed.change
                events = feed.events_after(after)
                if events is None:
                    events = await store.events_after(job_id, after)
                if events:
                    after = events[-1].seq
                    yield events
                elif feed.end is not None:
                    await feed.end  # raises what ended the reader
                    return
                else:
                    await change.wait()
                    if not feed.events_after(after) and feed.end is None:
                        yield ()
        finally:
            feed.listeners -= 1
            if not feed.listeners:
                feed.stop_reading()
                if self._feeds.get(job_id) is feed:
                    del self._feeds[job_id]

    async def wait_for_end(self, store: JobStore, job_id: str, timeout_s: float) -> JobRecord:
        """Wait until the job has ended or ``timeout_s`` has passed; returns its state then. Raises ``NotFound``."""
        deadline = asyncio.get_running_loop().time() + timeout_s
        with self.watch_job(job_id) as change:
            while True:
                change.clear()
                record = await store.get(job_id)
                left_s = deadline - asyncio.get_running_loop().time()
                if record.is_final or left_s <= 0:
                    return record
                with contextlib.suppress(asyncio.TimeoutError):
                    await asyncio.wait_for(change.wait(), min(left_s, FALLBACK_S))

    def _wake_watchers(self, _channel: str, job_id: str) -> None:
        for event in self._watchers.get(job_id, ()):
            event.set()

    def _wake_all(self) -> None:
        for events in self._watchers.values():
            for event in events:
                event.set()


class _JobFeed:
    """The events of one job, read once for all its listeners in this process.

    ``change`` is set and replaced after every reading.
    """

    def __init__(self, job_id: str, after: int) -> None:
        self.job_id, self.listeners = job_id, 0
        self.change = asyncio.Event()
        self._last_seq = after
        self._recent: deque[JobEvent] = deque(maxlen=RECENT_EVENTS)
        self._before_recent = after
        """Number of the event before the recent ones."""
        self._reader: asyncio.Task[None] | None = None

    @property
    def end(self) -> "asyncio.Task[None] | None":
        """The reader, once it has ended."""
        return self._reader if self._reader is not None and self._reader.done() else None

    def events_after(self, after: int) -> tuple[JobEvent, ...] | None:
        """The events that were read with numbers above ``after``; None if older ones are needed, too."""
        if after < self._before_recent:
            return None
        if after >= self._last_seq:
            return ()
        return tuple(event for event in self._recent if event.seq > after)

    def start_reading(self, board: JobNotifications, store: JobStore, closing: asyncio.Event | None) -> None:
        """Read in a task until the job has ended, or ``closing`` is set."""
        self._reader = asyncio.create_task(self._read_events(board, store, closing or asyncio.Event()))
        self._reader.add_done_callback(lambda _: self._wake_listeners())

    def stop_reading(self) -> None:
        """End the task without waiting for it."""
        if self._reader is not None and not self._reader.cancel() and not self._reader.cancelled():
            self._reader.exception()  # seen, if a listener has not seen it

    async def _read_events(self, board: JobNotifications, store: JobStore, closing: asyncio.Event) -> None:
        with board.watch_job(self.job_id) as change:
            while not closing.is_set():
                change.clear()
                record = await store.get(self.job_id)
                events = await store.events_after(self.job_id, self._last_seq)
                if record.is_final and not events:
                    return
                self._add_events(events)
                self._wake_listeners()
                if not record.is_final:  # else until all events are read
                    await _wait_for_either(change, closing, FALLBACK_S)

    def _add_events(self, events: Sequence[JobEvent]) -> None:
        for event in events:
            if len(self._recent) == RECENT_EVENTS:
                self._before_recent = self._recent[0].seq
            self._recent.append(event)
            self._last_seq = event.seq

    def _wake_listeners(self) -> None:
        self.change.set()
        self.change = asyncio.Event()


async def _wait_for_either(first: asyncio.Event, second: asyncio.Event, timeout_s: float) -> None:
    waits = [asyncio.ensure_future(event.wait()) for event in (first, second)]
    try:
        await asyncio.wait(waits, timeout=timeout_s, return_when=asyncio.FIRST_COMPLETED)
    finally:
        for wait in waits:
            wait.cancel()
