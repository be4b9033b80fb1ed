"""One attempt of a job, from staging its files to publishing its result."""

import asyncio
import contextlib
import hashlib
import shutil
import tempfile
import time
from collections.abc import Awaitable, Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, Final, TypeVar

import structlog
from sqlalchemy.ext.asyncio import AsyncEngine

from stridelab.errors import StridelabError, Unavailable, is_disk_full, problem_of, scratch_full_error
from stridelab.machine.cluster import scheduler_address
from stridelab.schemas.jobs import FINAL_STATES
from stridelab.service import telemetry
from stridelab.service.jobs.attempts import AttemptStore, FinalState
from stridelab.service.jobs.partial_results import NumberedChunk, PartialReader
from stridelab.service.jobs.queue import DATABASE_UNAVAILABLE, Attempt
from stridelab.service.kinds.base import JobKind, Json
from stridelab.service.processes.pool import IsolatedPool
from stridelab.service.processes.running_child import IsolatedOutcome
from stridelab.service.settings import Settings
from stridelab.service.storage.blobs import BlobStore
from stridelab.service.storage.file_removal import may_remove
from stridelab.service.storage.publication import Publication, publish_files

PROGRESS_S: Final = 0.2
"""Progress is written to the database at most this often."""
FIRST_PROGRESS_S: Final = 0.05
"""Delay of the first progress: an attempt that ends earlier writes none."""
DatabaseRetry = Callable[[Callable[[], Awaitable[Any]]], Awaitable[Any]]
"""Repeats a database operation while the database is unavailable."""

_TRANSIENT_CODES: Final = frozenset({"storage-unavailable", "storage-full", "scratch-full"})
"""Codes of transient errors that the job did not cause."""
_MAX_PAUSE_S: Final = 5.0
_STATEMENT_S: Final = 1.0
"""How long the end of an attempt waits for a statement of its helpers."""
_log = structlog.get_logger(__name__)
T = TypeVar("T")


class AttemptRunner:
    """Runs one attempt of a job in a child process."""

    def __init__(
        self,
        attempt: Attempt,
        kind: JobKind,
        attempts: AttemptStore,
        blobs: BlobStore,
        limits: Settings,
        retry_database: DatabaseRetry,
    ) -> None:
        self._attempt, self._kind, self._attempts, self._blobs = attempt, kind, attempts, blobs
        self._retry_database = retry_database
        self._timeout_s = kind.timeout_s or limits.job_timeout_s
        self._sandbox = kind.sandbox
        if kind.sandbox is not None and kind.spans_nodes and limits.dask_url is not None:
            self._sandbox = replace(kind.sandbox, connects=scheduler_address(limits.dask_url)[1])
        self._memory_mb = kind.memory_mb or limits.job_memory_mb
        self._patience_s, self._max_attempts = limits.storage_patience_s, limits.job_max_attempts
        self._kill_requested = asyncio.Event()
        self._interrupted = False
        self._latest_progress: tuple[float, str] | None = None
        self._parts: PartialReader | None = None
        self._unstored: list[NumberedChunk] = []
        self._progress_arrived = asyncio.Event()
        self._check_requested = asyncio.Event()
        self._statement = asyncio.Lock()

    @property
    def job_id(self) -> str:
        """The job of this attempt."""
        return self._attempt.job_id

    def interrupt(self) -> None:
        """Kill the child and hand the job back, because the worker stops."""
        self._interrupted = True
        self._kill_requested.set()

    def check_cancellation(self) -> None:
        """Check whether the job was cancelled or given to another worker."""
        self._check_requested.set()

    async def run(self, engine: AsyncEngine, pool: IsolatedPool, root: Path) -> str:
        """Stage, compute and publish in a new folder below ``root``; returns the final state of the attempt."""
        helpers = [asyncio.create_task(helper()) for helper in (self._report_progress, self._watch_cancellation)]
        try:
            state = await self._run_attempt(engine, pool, root)
            if state in FINAL_STATES:
                await self._remove_own_files(engine)
            return state
        finally:
            await self._cancel_helpers(helpers)

    async def _cancel_helpers(self, helpers: list[asyncio.Task[None]]) -> None:
        """Cancel the helpers between two statements: one that is cancelled costs its connection to the database."""
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(_STATEMENT_S):
                await self._statement.acquire()
        for helper in helpers:
            helper.cancel()
        await asyncio.gather(*helpers, return_exceptions=True)

    async def _remove_own_files(self, engine: AsyncEngine) -> None:
        """Remove the files stored for this job alone; the janitor removes what remains."""
        if self._kind.own_files is None:
            return
        with contextlib.suppress(StridelabError, *DATABASE_UNAVAILABLE):
            async with engine.begin() as connection:
                if await may_remove(connection):
                    await self._blobs.delete_prefix(self._kind.own_files(self._attempt.row["input"]))

    async def _run_attempt(self, engine: AsyncEngine, pool: IsolatedPool, root: Path) -> str:
        folder: Path | None = None
        later: asyncio.Task[None] | None = None
        log_tail = ""
        try:
            folder = await self._retry_storage(lambda: _folder_below(root))
            with telemetry.start_span("stage"):
                task = await self._stage_with_retries(engine, folder)
            if self._kind.shows_parts:
                with explain_full_disk():
                    self._parts = PartialReader(folder)
            if self._kind.stage_later is not None:
                later = asyncio.ensure_future(self._kind.stage_later(self._blobs, task, folder))
            with telemetry.start_span("compute") as computing:
                outcome = await pool.run(
                    self._kind.run,
                    task,
                    folder,
                    timeout_s=self._timeout_s,
                    memory_mb=self._memory_mb,
                    cancel=self._kill_requested,
                    on_progress=self._note_progress,
                    sandbox=self._sandbox,
                )
                computing.set_attribute("outcome", outcome.state)
            log_tail = outcome.log_tail
            if outcome.state == "ok" and "problem" in outcome.value:
                return await self._fail_with_partial_result(outcome, folder)
            if outcome.state == "ok":
                return await self._publish_result(outcome, folder)
            return await self._end_failed_computation(outcome)
        except StridelabError as error:
            if self._kill_requested.is_set():
                return await self._end_stopped(log_tail)
            return await self._end_unsuccessful("failed", problem_of(error), log_tail)
        except DATABASE_UNAVAILABLE:
            raise  # the worker stops while the database is unavailable: another worker takes the job over
        except Exception as error:  # noqa: BLE001 (an unexpected error in staging or publishing fails this job only)
            _log.exception("job-broke")
            problem = {
                "code": "internal-error",
                "detail": f"The service could not handle this job ({type(error).__name__}).",
                "errors": [],
            }
            return await self._end_unsuccessful("failed", problem, log_tail)
        finally:
            if later is not None:
                later.cancel()
                await asyncio.gather(later, return_exceptions=True)
            parts, self._parts = self._parts, None
            if parts is not None:
                parts.close()
            if folder is not None:
                await asyncio.to_thread(shutil.rmtree, folder, ignore_errors=True)

    async def _retry_storage(self, operation: Callable[[], Awaitable[T]]) -> T:
        """Repeat a file operation while the storage is unavailable or the disk is full.

        Raises the last error after ``storage_patience_s`` or when the attempt is stopped.
        """
        since, pause_s = time.monotonic(), 0.1
        while True:
            try:
                return await operation()
            except Unavailable as error:
                waited_s = time.monotonic() - since
                if error.code not in _TRANSIENT_CODES or waited_s > self._patience_s or self._kill_requested.is_set():
                    raise
                _log.warning("files-are-away", code=error.code, waited_s=round(waited_s, 1))
            with contextlib.suppress(asyncio.TimeoutError):
                await asyncio.wait_for(self._kill_requested.wait(), pause_s)
            pause_s = min(2 * pause_s, _MAX_PAUSE_S)

    async def _stage_with_retries(self, engine: AsyncEngine, folder: Path) -> Json:
        return await self._retry_storage(lambda: self._retry_database(lambda: self._stage_files(engine, folder)))

    async def _stage_files(self, engine: AsyncEngine, folder: Path) -> Json:
        request = self._kind.input_model.model_validate(self._attempt.row["input"])
        with explain_full_disk():
            async with engine.connect() as connection:
                return await self._kind.stage(connection, self._blobs, request, folder)

    async def _publish_result(self, outcome: IsolatedOutcome, folder: Path) -> str:
        async def write_success(artifacts: list[Json], publication: Publication) -> bool:
            return await self._attempts.publish_success(
                self._attempt, self._blobs, outcome.value, artifacts, folder, outcome.log_tail, publication
            )

        with telemetry.start_span("publish"):
            published = await self._store_files_and_write(outcome, folder, write_success)
        return "succeeded" if published else await self._end_unsuccessful("cancelled", None, outcome.log_tail)

    async def _fail_with_partial_result(self, outcome: IsolatedOutcome, folder: Path) -> str:
        """Fail with the partial result of the computation."""
        value = outcome.value

        async def write_failure(artifacts: list[Json], publication: Publication) -> bool:
            return await self._attempts.end_attempt(
                self._attempt, "failed", value["problem"], outcome.log_tail, (value, artifacts), publication
            )

        return "failed" if await self._store_files_and_write(outcome, folder, write_failure) else "superseded"

    async def _store_files_and_write(
        self,
        outcome: IsolatedOutcome,
        folder: Path,
        write: Callable[[list[Json], Publication], Awaitable[bool]],
    ) -> bool:
        """Store the artifacts and ``write`` the row that refers to them; a failed publication removes the files."""
        artifacts = await asyncio.to_thread(lambda: [artifact_file(folder, i) for i in outcome.value["artifacts"]])
        prefix = self._attempt.blob_prefix

        async with publish_files(lambda: self._blobs.delete_prefix(prefix)) as publication:

            async def store_and_write() -> bool:
                for artifact in artifacts:
                    await self._blobs.put_file(f"{prefix}/{artifact['name']}", folder / artifact["name"])
                return bool(await self._retry_database(lambda: write(artifacts, publication)))

            publication.record_outcome(published=await self._retry_storage(store_and_write))
        return publication.published

    async def _end_failed_computation(self, outcome: IsolatedOutcome) -> str:
        if outcome.state == "cancelled":
            return await self._end_stopped(outcome.log_tail)
        if outcome.state == "killed" and self._attempt.counted_starts < self._max_attempts:
            back = await self._retry_database(lambda: self._attempts.hand_back(self._attempt, counts=True))
            return "killed" if back else "superseded"
        state: FinalState = "timed_out" if outcome.state == "timeout" else "failed"
        problem = outcome.problem
        if problem is not None and outcome.error_class is None and self._latest_progress is not None:
            problem = add_last_progress(problem, self._latest_progress[1])
        return await self._end_unsuccessful(state, problem, outcome.log_tail)

    async def _end_stopped(self, log_tail: str) -> str:
        """End a stopped attempt: as cancelled, or by handing the job back if the worker stops."""
        if not self._interrupted:
            return await self._end_unsuccessful("cancelled", None, log_tail)
        handed_back = await self._retry_database(lambda: self._attempts.hand_back(self._attempt))
        return "handed-back" if handed_back else "superseded"

    async def _end_unsuccessful(self, state: FinalState, problem: Json | None, log_tail: str) -> str:
        ended = await self._retry_database(lambda: self._attempts.end_attempt(self._attempt, state, problem, log_tail))
        return state if ended else "superseded"

    def _note_progress(self, fraction: float, message: str) -> None:
        self._latest_progress = (fraction, message)
        self._progress_arrived.set()

    async def _report_progress(self) -> None:
        """Write the latest progress, soon after the first one and then at most every ``PROGRESS_S``."""
        await self._progress_arrived.wait()
        await asyncio.sleep(FIRST_PROGRESS_S)
        while True:
            await self._progress_arrived.wait()
            self._progress_arrived.clear()
            if self._latest_progress is not None:
                with contextlib.suppress(*DATABASE_UNAVAILABLE):  # a lost progress report is replaced by the next one
                    if self._parts is not None:
                        self._unstored += self._parts.read_new()
                    async with self._statement:
                        goes_on = await self._attempts.report_progress(
                            self._attempt, *self._latest_progress, self._unstored
                        )
                    if not goes_on:
                        self._kill_requested.set()
                    self._unstored = []
            await asyncio.sleep(PROGRESS_S)

    async def _watch_cancellation(self) -> None:
        """Kill the child when the job was cancelled or given to another worker."""
        while not self._kill_requested.is_set():
            await self._check_requested.wait()
            self._check_requested.clear()
            try:
                async with self._statement:
                    stops = await self._attempts.should_stop(self._attempt)
                if stops:
                    self._kill_requested.set()
            except DATABASE_UNAVAILABLE:
                await asyncio.sleep(0.5)
                self._check_requested.set()


async def _folder_below(root: Path) -> Path:
    with explain_full_disk():
        return Path(await asyncio.to_thread(tempfile.mkdtemp, dir=root))


@contextlib.contextmanager
def explain_full_disk() -> Iterator[None]:
    """Convert the ``OSError`` of a full disk of the worker to ``StorageFull`` (``scratch-full``)."""
    try:
        yield
    except OSError as error:
        if not is_disk_full(error):
            raise
        raise scratch_full_error() from error


def add_last_progress(problem: Json, message: str) -> Json:
    """Add the last progress message to the problem of a computation that was killed or crashed.

    Messages have the form ``"<stage>: <activity>"`` or name only the stage.
    """
    fault = {"where": f"stage: {message.partition(':')[0]}", "message": f"last progress message: {message}"}
    detail = f"{problem['detail']} Last progress message: {message}."
    return {**problem, "detail": detail, "errors": [*problem["errors"], fault]}


def artifact_file(folder: Path, item: Json) -> Json:
    """The artifact with size and SHA-256; raises ``ValueError`` unless it is a regular file directly in ``folder``."""
    path = folder / str(item["name"])
    if path.parent != folder or path.is_symlink() or not path.is_file():
        raise ValueError(f"the computation wrote no file {item['name']!r}")
    with path.open("rb") as file:
        sha256 = hashlib.file_digest(file, "sha256").hexdigest()
    described = {"name": path.name, "media_type": str(item["media_type"])}
    return described | {"bytes": path.stat().st_size, "sha256": sha256}
