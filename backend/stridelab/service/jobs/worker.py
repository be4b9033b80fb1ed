"""``python -m stridelab.service.jobs.worker``: takes jobs from the queue and runs each in a child process.

The event loop only waits and writes rows; computations run in the children. If the database becomes unavailable, the
children keep computing and the worker publishes later; a worker that is stopped hands its jobs back to the queue.
"""

import asyncio
import contextlib
import signal
import sys
import time
from collections.abc import Awaitable, Callable, Mapping, Sequence
from pathlib import Path
from typing import Final, TypeVar

import structlog
from opentelemetry.trace import SpanKind

from stridelab.errors import StridelabError, Unavailable
from stridelab.machine import heartbeat
from stridelab.machine.cores import cores_per_slot, default_slots
from stridelab.service import telemetry
from stridelab.service.jobs import retention
from stridelab.service.jobs.attempt_runner import AttemptRunner
from stridelab.service.jobs.attempts import AttemptStore
from stridelab.service.jobs.events import CANCEL_CHANNEL, QUEUE_CHANNEL
from stridelab.service.jobs.notifications import Listener
from stridelab.service.jobs.queue import DATABASE_UNAVAILABLE, LANES, Attempt, Lane, QueueConsumer
from stridelab.service.jobs.work_folder import HEARTBEAT_FILE, WorkFolder
from stridelab.service.kinds.base import JobKind
from stridelab.service.processes import confinement
from stridelab.service.processes.pool import IsolatedPool
from stridelab.service.settings import Settings, current_settings
from stridelab.service.storage.blobs import BlobStore
from stridelab.service.storage.database import database_url, is_migrated, make_engine

_POLL_S: Final = 5.0
_REAP_S: Final = 2.0
_RETENTION_S: Final = 3600.0
_HAND_BACK_S: Final = 3.0
_log = structlog.get_logger(__name__)
T = TypeVar("T")


class Worker:
    """Slots that fetch and run jobs until ``stop`` is set."""

    def __init__(
        self,
        url: str,
        blobs: BlobStore,
        kinds: Mapping[str, JobKind],
        limits: Settings,
        preload: Sequence[str] = (),
    ) -> None:
        self._url, self._blobs, self._kinds, self._limits = url, blobs, kinds, limits
        self._engine = make_engine(url)
        self._attempts = AttemptStore(self._engine, kinds, max_attempts=limits.job_max_attempts)
        self._consumer = QueueConsumer(url)
        slots = limits.worker_slots or default_slots()
        self._slots: tuple[tuple[Lane, ...], ...] = (("short",), *((LANES,) * slots))
        self._pool = IsolatedPool(preload, limits.job_niceness, cores_per_slot(slots))
        self._runners: list[AttemptRunner] = []
        self._wake_ups: list[asyncio.Event] = []
        self._stopping = asyncio.Event()
        self._heartbeats_valid_since: float | None = None

    def stop(self) -> None:
        """Stop fetching, kill the children and hand the jobs back."""
        self._stopping.set()
        for event in self._wake_ups:
            event.set()
        for errand in self._runners:
            errand.interrupt()

    async def run(self) -> None:
        """Fetch and run jobs until ``stop``. Raises as ``prepare_confinement`` does."""
        with WorkFolder(self._limits.data_folder / "work") as folder:
            confinement.prepare_confinement(self._limits, self._limits.data_folder, folder.parent, folder)
            listener = Listener(self._url, [QUEUE_CHANNEL, CANCEL_CHANNEL], self._on_notify, self._on_gap)
            async with self._pool, listener:
                slots = [asyncio.create_task(self._run_slot(lanes, folder)) for lanes in self._slots]
                _log.info("worker-started", slots=[list(lanes) for lanes in self._slots])
                background = [
                    asyncio.create_task(keep())
                    for keep in (self._heartbeat_loop, self._reap_loop, self._retention_loop)
                ]
                try:
                    await self._until_stopped([*slots, *background])
                    await asyncio.wait(slots, timeout=_HAND_BACK_S)
                finally:
                    for task in (*slots, *background):
                        task.cancel()
                    await asyncio.gather(*slots, *background, return_exceptions=True)
                with contextlib.suppress(*DATABASE_UNAVAILABLE):
                    await self._consumer.unregister_worker()
        await self._consumer.close()
        await self._engine.dispose()

    async def _until_stopped(self, tasks: list[asyncio.Task[None]]) -> None:
        stop_task = asyncio.create_task(self._stopping.wait())
        await asyncio.wait([stop_task, *tasks], return_when=asyncio.FIRST_COMPLETED)
        for task in tasks:
            if task.done() and not self._stopping.is_set():
                task.result()  # a loop that ends by itself is a bug: the process exits and is restarted
        stop_task.cancel()

    async def _run_slot(self, lanes: tuple[Lane, ...], folder: Path) -> None:
        wake_up = asyncio.Event()
        self._wake_ups.append(wake_up)
        while not self._stopping.is_set():
            wake_up.clear()
            try:
                attempt = await self._consumer.claim_attempt(lanes)
            except DATABASE_UNAVAILABLE:
                self._mark_database_unavailable()
                await self._pause_or_stop(0.3)
                continue
            if attempt is None:
                with contextlib.suppress(asyncio.TimeoutError):
                    await asyncio.wait_for(wake_up.wait(), _POLL_S)
            else:
                await self._run_traced(attempt, folder)
                self._consumer.release_attempt(attempt)

    async def _run_traced(self, attempt: Attempt, folder: Path) -> None:
        """Run the attempt; log lines and spans carry the job's ids."""
        ids: dict[str, str | int] = {"job_id": attempt.job_id, "kind": attempt.kind, "attempt": attempt.number}
        parent = attempt.row["traceparent"]
        with (
            structlog.contextvars.bound_contextvars(**ids),
            telemetry.start_span(f"job {attempt.kind}", ids, parent=parent, kind=SpanKind.CONSUMER) as span,
        ):
            state = await self._run_attempt(attempt, folder)
            span.set_attribute("state", state)

    async def _run_attempt(self, attempt: Attempt, folder: Path) -> str:
        if attempt.kind not in self._kinds:
            problem = {"code": "unknown-job-kind", "detail": f"This version cannot run {attempt.kind}.", "errors": []}
            await self._retry_database(lambda: self._attempts.end_attempt(attempt, "failed", problem, ""))
            return "failed"
        kind, retry = self._kinds[attempt.kind], self._retry_database
        errand = AttemptRunner(attempt, kind, self._attempts, self._blobs, self._limits, retry)
        self._runners.append(errand)
        began = time.monotonic()
        try:
            if self._stopping.is_set():
                errand.interrupt()
            state = await errand.run(self._engine, self._pool, folder)
            _log.info("job-ended", state=state, seconds=round(time.monotonic() - began, 3))
            return state
        finally:
            self._runners.remove(errand)

    async def _retry_database(self, operation: Callable[[], Awaitable[T]]) -> T:
        """Repeat a database operation until the database is available; a stopping worker gives up after a second."""
        pause_s = 0.1
        while True:
            try:
                return await operation()
            except DATABASE_UNAVAILABLE:
                self._mark_database_unavailable()
                if self._stopping.is_set() and pause_s > 1.0:
                    raise
                await asyncio.sleep(pause_s)
                pause_s = min(2 * pause_s, 2.0)

    def _mark_database_unavailable(self) -> None:
        self._heartbeats_valid_since = None

    async def _pause_or_stop(self, seconds: float) -> None:
        with contextlib.suppress(asyncio.TimeoutError):
            await asyncio.wait_for(self._stopping.wait(), seconds)

    async def _heartbeat_loop(self) -> None:
        while True:
            try:
                await self._send_heartbeat()
                with contextlib.suppress(OSError):  # a full disk affects only the health check
                    (self._limits.data_folder / HEARTBEAT_FILE).touch()
                await asyncio.sleep(self._limits.heartbeat_s)
            except DATABASE_UNAVAILABLE:
                self._mark_database_unavailable()
                await asyncio.sleep(0.3)

    async def _send_heartbeat(self) -> None:
        silent_s = await self._consumer.send_heartbeat()
        if self._heartbeats_valid_since is None:
            self._heartbeats_valid_since = time.monotonic()
        elif silent_s > self._limits.stall_s / 2:
            # own heartbeat late: the machine was suspended, or the clock of the database jumped, which is no sign of
            # death; each worker has the stall time for its next heartbeat, as ever
            longer_s = max(0.0, self._limits.stall_s - 2 * self._limits.heartbeat_s)
            self._heartbeats_valid_since = time.monotonic() + longer_s

    async def _reap_loop(self) -> None:
        while True:
            await asyncio.sleep(_REAP_S)
            try:
                await self._send_heartbeat()  # first, or this worker could take its own jobs
                since = self._heartbeats_valid_since
                # after an outage all heartbeats are old: wait until every worker had time to send one
                heard_all = since is not None and time.monotonic() - since > 2 * self._limits.heartbeat_s
                lost = await self._attempts.requeue_lost(self._limits.stall_s if heard_all else None)
            except DATABASE_UNAVAILABLE:
                self._mark_database_unavailable()
                continue
            if lost:
                _log.warning("jobs-taken-from-lost-workers", jobs=lost)

    async def _retention_loop(self) -> None:
        while True:
            try:
                await retention.remove_expired(self._engine, self._blobs, self._limits)
            except (StridelabError, *DATABASE_UNAVAILABLE) as error:
                _log.warning("retention-failed", error=str(error))
            await asyncio.sleep(_RETENTION_S)

    def _on_notify(self, channel: str, payload: str) -> None:
        if channel != CANCEL_CHANNEL:
            for news in self._wake_ups:
                news.set()
        for errand in self._runners:
            if errand.job_id == payload:
                errand.check_cancellation()

    def _on_gap(self) -> None:
        for news in self._wake_ups:
            news.set()
        for errand in self._runners:
            errand.check_cancellation()


async def run_worker(limits: Settings, kinds: Mapping[str, JobKind], preload: Sequence[str] = ()) -> None:
    """Run one worker on the configured database until SIGTERM or SIGINT; its children have imported ``preload``.

    Raises ``Unavailable`` (``database-url-missing``, ``database-not-migrated``), ``InvalidInput``
    (``otlp-url-invalid``).
    """
    beating = asyncio.create_task(heartbeat.write_heartbeats())  # noqa: F841, RUF006 (a task lives as long as it is referred to)
    url = database_url(limits)
    if url is None:
        raise Unavailable("database-url-missing", "A worker needs STRIDELAB_DATABASE_URL.")
    deadline = time.monotonic() + 60.0
    while not await asyncio.to_thread(is_migrated, url):
        if time.monotonic() > deadline:
            raise Unavailable(
                "database-not-migrated", "The database does not respond, or `stridelab migrate` has not been run on it."
            )
        await asyncio.sleep(0.5)
    blobs = BlobStore.from_url(limits.blob_address, limits.blob_options)
    worker = Worker(url, blobs, kinds, limits, preload)
    loop = asyncio.get_running_loop()
    for signum in (signal.SIGTERM, signal.SIGINT):
        loop.add_signal_handler(signum, worker.stop)
    with telemetry.export_spans(limits.otlp_url, "worker"):
        await worker.run()


def main() -> None:
    """Entry point: a worker for all job kinds."""
    from stridelab.service.kinds.registry import COMPUTING, KINDS
    from stridelab.service.logging import configure_logging

    limits = current_settings()
    configure_logging(limits.log_level)
    try:
        asyncio.run(run_worker(limits, KINDS, COMPUTING))
    except StridelabError as error:
        sys.exit(error.message)


if __name__ == "__main__":
    main()
