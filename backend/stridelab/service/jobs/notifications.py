"""Notifications of job changes: one LISTEN connection wakes event streams, long polls and workers.

A notification only announces a change; the state is read from the tables. A lost notification therefore causes a delay
and no wrong state: all watchers read again after every reconnection and at least every ``FALLBACK_S``.
"""

import asyncio
import contextlib
from collections.abc import AsyncIterator, Callable, Iterator, Sequence
from typing import Final, Self

import psycopg
import structlog
from psycopg import sql

from stridelab.schemas.jobs import JobEvent
from stridelab.service.jobs.store import CHANNEL, JobRecord, JobStore
from stridelab.service.storage.database import CONNECTION_OPTIONS, libpq_url

FALLBACK_S: Final = 15.0
"""Polling interval without notifications."""
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

    async def follow_events(self, store: JobStore, job_id: str, after: int = 0) -> AsyncIterator[tuple[JobEvent, ...]]:
        """The job's events after number ``after``, as they are written, until the job has ended.

        Yields an empty tuple after ``FALLBACK_S`` without events (as a keep-alive). Raises ``NotFound``.
        """
        with self.watch_job(job_id) as change:
            while True:
                change.clear()
                record = await store.get(job_id)
                events = await store.events_after(job_id, after)
                if events:
                    after = events[-1].seq
                elif record.is_final:
                    return
                yield events
                if record.is_final:
                    continue  # until all events are sent
                with contextlib.suppress(asyncio.TimeoutError):
                    await asyncio.wait_for(change.wait(), FALLBACK_S)

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
