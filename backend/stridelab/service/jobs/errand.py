"""One attempt of a job, from staging its files to publishing its result."""

import asyncio
import contextlib
import shutil
import tempfile
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any, Final

import structlog
from sqlalchemy.ext.asyncio import AsyncEngine

from stridelab.errors import StridelabError
from stridelab.service.jobs.attempts import Attempt, Attempts, FinalState
from stridelab.service.jobs.consumer import DATABASE_IS_AWAY
from stridelab.service.jobs.isolated import IsolatedOutcome, IsolatedPool
from stridelab.service.jobs.kinds.kind import JobKind, Json, problem_of
from stridelab.service.settings import Settings
from stridelab.service.storage.blobs import BlobStore

PROGRESS_S: Final = 0.2
"""Progress is written to the database at most this often."""
Patiently = Callable[[Callable[[], Awaitable[Any]]], Awaitable[Any]]
"""Repeats a database operation for as long as the database is away."""
_log = structlog.get_logger(__name__)


class Errand:
    """Runs one attempt. ``interrupt`` because the worker stops, ``look_again`` when it may have been cancelled."""

    def __init__(self, attempt: Attempt, kind: JobKind, attempts: Attempts, blobs: BlobStore, limits: Settings) -> None:
        self._attempt, self._kind, self._attempts, self._blobs = attempt, kind, attempts, blobs
        self._timeout_s = kind.timeout_s or limits.job_timeout_s
        self._memory_mb = kind.memory_mb or limits.job_memory_mb
        self._kill = asyncio.Event()
        self._interrupted = False
        self._latest: tuple[float, str] | None = None
        self._progress = asyncio.Event()
        self._look = asyncio.Event()

    @property
    def job_id(self) -> str:
        """The job of this attempt."""
        return self._attempt.job_id

    def interrupt(self) -> None:
        """Kill the child and hand the job back."""
        self._interrupted = True
        self._kill.set()

    def look_again(self) -> None:
        """Find out whether this attempt should go on."""
        self._look.set()

    async def run(self, engine: AsyncEngine, pool: IsolatedPool, folder: Path, patiently: Patiently) -> str:
        """Do all of it; returns how it ended."""
        mine = Path(tempfile.mkdtemp(dir=folder))
        try:
            return await self._run(engine, pool, mine, patiently)
        finally:
            await asyncio.to_thread(shutil.rmtree, mine, ignore_errors=True)

    async def _run(self, engine: AsyncEngine, pool: IsolatedPool, folder: Path, patiently: Patiently) -> str:
        helpers = [asyncio.create_task(helper()) for helper in (self._report, self._watch)]
        log_tail = ""
        try:
            task = await patiently(lambda: self._stage(engine, folder))
            outcome = await pool.run(
                self._kind.run,
                task,
                folder,
                timeout_s=self._timeout_s,
                memory_mb=self._memory_mb,
                cancel=self._kill,
                on_progress=self._note,
            )
            log_tail = outcome.log_tail
            if outcome.state == "ok" and "problem" in outcome.value:
                return await self._keep(outcome, folder, patiently)
            if outcome.state == "ok":
                return await self._publish(outcome, folder, patiently)
            return await self._give_up(outcome, patiently)
        except StridelabError as error:
            return await self._end("failed", problem_of(error), log_tail, patiently)
        except DATABASE_IS_AWAY:
            raise  # the worker stops while the database is away: another one will take the job up
        except Exception as error:  # noqa: BLE001 (what staging and publishing were not made for fails this job only)
            _log.exception("job-broke")
            problem = {
                "code": "internal-error",
                "detail": f"The service could not handle this job ({type(error).__name__}).",
                "errors": [],
            }
            return await self._end("failed", problem, log_tail, patiently)
        finally:
            for helper in helpers:
                helper.cancel()
            await asyncio.gather(*helpers, return_exceptions=True)

    async def _stage(self, engine: AsyncEngine, folder: Path) -> Json:
        request = self._kind.input_model.model_validate(self._attempt.row["input"])
        async with engine.connect() as connection:
            return await self._kind.stage(connection, self._blobs, request, folder)

    async def _publish(self, outcome: IsolatedOutcome, folder: Path, patiently: Patiently) -> str:
        async def publish(artifacts: list[Json]) -> bool:
            return await self._attempts.succeed(
                self._attempt, self._blobs, outcome.value, artifacts, folder, outcome.log_tail
            )

        published = await self._with_files(outcome, folder, patiently, publish)
        return "succeeded" if published else await self._end("cancelled", None, outcome.log_tail, patiently)

    async def _keep(self, outcome: IsolatedOutcome, folder: Path, patiently: Patiently) -> str:
        """Fail, with what the computation left all the same."""
        value = outcome.value

        async def fail(artifacts: list[Json]) -> bool:
            return await self._attempts.end(
                self._attempt, "failed", value["problem"], outcome.log_tail, (value, artifacts)
            )

        return "failed" if await self._with_files(outcome, folder, patiently, fail) else "superseded"

    async def _with_files(
        self,
        outcome: IsolatedOutcome,
        folder: Path,
        patiently: Patiently,
        write: Callable[[list[Json]], Awaitable[bool]],
    ) -> bool:
        """Store the files and ``write`` the row that names them; where that is not to be, no file stays."""
        artifacts = [artifact_file(folder, item) for item in outcome.value["artifacts"]]
        prefix = self._attempt.blob_prefix
        for artifact in artifacts:
            await self._blobs.put_file(f"{prefix}/{artifact['name']}", folder / artifact["name"])
        written = False
        try:
            written = bool(await patiently(lambda: write(artifacts)))
        finally:
            if not written:
                with contextlib.suppress(StridelabError):  # what stays is removed by the janitor
                    await self._blobs.delete_prefix(prefix)
        return written

    async def _give_up(self, outcome: IsolatedOutcome, patiently: Patiently) -> str:
        if outcome.state == "cancelled" and self._interrupted:
            handed_back = await patiently(lambda: self._attempts.hand_back(self._attempt))
            return "handed-back" if handed_back else "superseded"
        if outcome.state == "cancelled":
            return await self._end("cancelled", None, outcome.log_tail, patiently)
        state: FinalState = "timed_out" if outcome.state == "timeout" else "failed"
        problem = outcome.problem
        if problem is not None and outcome.raised is None and self._latest is not None:
            problem = located(problem, self._latest[1])
        return await self._end(state, problem, outcome.log_tail, patiently)

    async def _end(self, state: FinalState, problem: Json | None, log_tail: str, patiently: Patiently) -> str:
        ended = await patiently(lambda: self._attempts.end(self._attempt, state, problem, log_tail))
        return state if ended else "superseded"

    def _note(self, fraction: float, message: str) -> None:
        self._latest = (fraction, message)
        self._progress.set()

    async def _report(self) -> None:
        """Write the latest progress, at once and then at most every ``PROGRESS_S``."""
        while True:
            await self._progress.wait()
            self._progress.clear()
            if self._latest is not None:
                with contextlib.suppress(*DATABASE_IS_AWAY):  # progress is a courtesy: the next one will do
                    if not await self._attempts.report(self._attempt, *self._latest):
                        self._kill.set()
            await asyncio.sleep(PROGRESS_S)

    async def _watch(self) -> None:
        """Kill the child when the job was cancelled or given to another worker."""
        while not self._kill.is_set():
            await self._look.wait()
            self._look.clear()
            try:
                if await self._attempts.should_stop(self._attempt):
                    self._kill.set()
            except DATABASE_IS_AWAY:
                await asyncio.sleep(0.5)
                self._look.set()


def located(problem: Json, message: str) -> Json:
    """The problem of a computation that could not say itself where it was, with what it had last told.

    Messages read ``"<stage>: <what it does>"``, or name only the stage.
    """
    fault = {"where": f"stage: {message.partition(':')[0]}", "message": f"last heard: {message}"}
    detail = f"{problem['detail']} The last that it told: {message}."
    return {**problem, "detail": detail, "errors": [*problem["errors"], fault]}


def artifact_file(folder: Path, item: Json) -> Json:
    """The artifact with its size; raises ``ValueError`` for anything but a plain file right in ``folder``."""
    path = folder / str(item["name"])
    if path.parent != folder or path.is_symlink() or not path.is_file():
        raise ValueError(f"the computation left no file {item['name']!r}")
    return {"name": path.name, "media_type": str(item["media_type"]), "bytes": path.stat().st_size}
