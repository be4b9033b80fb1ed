"""Cache of robot facts, display meshes and reachability documents, computed in child processes.

The results are files of the store below ``robots/<name>/<hash>``, where the hash covers everything they are computed
from. Each file is published atomically. They are computed at the first start of a service, or earlier on
request, and reused after every later start. The service itself never imports a rigid-body library.
"""

import asyncio
import gzip
import time
import zlib
from collections.abc import Awaitable, Callable, Iterable, Mapping
from contextlib import AbstractAsyncContextManager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, Generic, TypeVar

import structlog
from pydantic import ValidationError
from sqlalchemy.ext.asyncio import AsyncEngine

from stridelab.errors import NotFound, StridelabError, Unavailable
from stridelab.robots.card import robot_names
from stridelab.schemas.robots import Measure, RobotFacts, RobotPackage, RobotPreparation
from stridelab.service.api.robots.children import DESCRIBE, LINKS, REACH, Progress, RobotChildren
from stridelab.service.processes.pool import IsolatedPool
from stridelab.service.processes.sandbox import STRICT, Sandbox
from stridelab.service.source_hash import CACHED_LINKS_FILE, cached_files_prefix
from stridelab.service.storage.blobs import BlobInfo, BlobStore
from stridelab.service.stored_robots import find_robot

T = TypeVar("T")


def require_robot(name: str) -> str:
    """Return ``name`` if a robot of this name exists; raises ``NotFound`` (``robot-not-found``) otherwise.

    The returned string is the registered one, so that user input is never used as a path.
    """
    names = robot_names()
    if name not in names:
        raise NotFound("robot-not-found", f"There is no robot of this name; available: {', '.join(names) or 'none'}.")
    return names[names.index(name)]


class SingleFlight(Generic[T]):
    """Single-flight cache: concurrent callers with the same key share one computation.

    Cancelling one caller does not cancel the computation for the others. A failed computation is repeated at the next
    call. With ``keep``, successful results are cached; otherwise they are shared among concurrent callers only.
    """

    def __init__(self, *, keep: bool) -> None:
        self._keep = keep
        self._tasks: dict[str, asyncio.Task[T]] = {}

    async def get(self, key: str, work: Callable[[], Awaitable[T]]) -> T:
        """Result of ``work()``, or of the computation that is already running or cached for ``key``."""
        task = self._tasks.get(key)
        if task is None:
            task = asyncio.ensure_future(_start_work(work))
            self._tasks[key] = task
            task.add_done_callback(lambda done: self._on_done(key, done))
        return await asyncio.shield(task)

    async def aclose(self) -> None:
        """Cancel the running computations."""
        tasks = list(self._tasks.values())
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)

    def _on_done(self, key: str, task: "asyncio.Task[T]") -> None:
        failed = task.cancelled() or task.exception() is not None
        if failed or not self._keep:
            del self._tasks[key]


async def _start_work(work: Callable[[], Awaitable[T]]) -> T:
    return await work()


log = structlog.get_logger(__name__)

FACTS_FILE: Final = "facts.json"
REACH_FILE: Final = "reachability.json.gz"
DESCRIBE_TIMEOUT_S: Final = 60.0
LINKS_TIMEOUT_S: Final = 180.0
REACH_TIMEOUT_S: Final = 120.0
RETRY_S: Final = 60.0
"""Time for which a failure is reported again without another attempt."""
STATUS_WAIT_S: Final = 0.5
"""Time for which a status request waits for a preparation, which is short if all files exist."""
FACTS_FRACTION, MESHES_FRACTION = 0.3, 0.6
"""Progress of the preparation after the facts, and after the meshes, as fractions."""


@dataclass(eq=False)
class RobotCache:
    """Robot cache of one application; ``describe``, ``draw`` and ``enclose`` are the targets of the child processes."""

    pool: IsolatedPool
    blobs: BlobStore
    spool: Path
    memory_mb: int
    describe: str = DESCRIBE
    draw: str = LINKS
    enclose: str = REACH
    _prefixes: SingleFlight[str] = field(default_factory=lambda: SingleFlight(keep=True))
    sandbox: Sandbox | None = STRICT
    _facts: SingleFlight[RobotFacts] = field(default_factory=lambda: SingleFlight(keep=True))
    _failed: dict[str, tuple[float, str]] = field(default_factory=dict)
    _links: SingleFlight[BlobInfo] = field(default_factory=lambda: SingleFlight(keep=False))
    _reach: SingleFlight[bytes] = field(default_factory=lambda: SingleFlight(keep=True))
    _prepared: SingleFlight[str | None] = field(default_factory=lambda: SingleFlight(keep=False))
    _ready: set[str] = field(default_factory=set)
    _progress: dict[str, tuple[float, str]] = field(default_factory=dict)
    _in_background: set[str] = field(default_factory=set)

    engine: AsyncEngine | None = None
    packages: SingleFlight[list[RobotPackage]] = field(default_factory=lambda: SingleFlight(keep=True))

    def __post_init__(self) -> None:
        self._children = RobotChildren(self.pool, self.spool, self.memory_mb, self.sandbox)

    async def facts(self, name: str) -> RobotFacts:
        """Facts of the robot ``name``.

        Raises ``Unavailable`` (``robot-data-missing``; ``robot-not-loaded`` if the child crashed or timed out).
        """

        async def load_facts() -> RobotFacts:
            key = f"{await self._key_prefix(name)}/{FACTS_FILE}"
            with suppress(ValidationError):  # not stored yet, or damaged
                return RobotFacts.model_validate_json(await self._read_stored(key) or b"")
            progress = self._progress_callback(name, 0.0, FACTS_FRACTION)
            async with self._run_child(self.describe, {"robot": name}, DESCRIBE_TIMEOUT_S, progress) as (value, folder):
                facts = RobotFacts.model_validate(value["summary"])
                await self._store_file(key, folder / FACTS_FILE, facts.model_dump_json().encode())
                return facts

        return await self._facts.get(name, load_facts)

    async def any_facts(self, name: str) -> RobotFacts:
        """Facts of a bundled robot or of a user's. Raises ``NotFound`` (``robot-not-found``) and as ``facts``."""
        if self.engine is not None and name not in robot_names():
            async with self.engine.connect() as connection:
                row = await find_robot(connection, name)
            if row is not None:
                return RobotFacts.model_validate({**row["facts"], "own": True})
        return await self.facts(require_robot(name))

    async def own_shapes(self, name: str) -> Mapping[str, Any] | None:
        """Stored effectors of the user's robot ``name``; None for any other name."""
        if self.engine is None or name in robot_names():
            return None
        async with self.engine.connect() as connection:
            row = await find_robot(connection, name)
        return None if row is None else dict(row["shapes"])

    async def load_problem(self, name: str) -> str | None:
        """Load the robot ``name`` if necessary; return the reason if that fails, else None.

        A failure is cached for ``RETRY_S``.
        """
        return await self._try_loading(name, lambda: self.facts(name))

    async def link_meshes(self, name: str) -> BlobInfo:
        """File with one named mesh per link (GLB), created if it does not exist. Raises the errors of ``facts``."""
        await self.facts(name)
        key = f"{await self._key_prefix(name)}/{CACHED_LINKS_FILE}"

        async def make_meshes() -> BlobInfo:
            info = await self.blobs.info(key)
            if info is None:
                progress = self._progress_callback(name, FACTS_FRACTION, MESHES_FRACTION)
                async with self._run_child(self.draw, {"robot": name}, LINKS_TIMEOUT_S, progress) as (_, folder):
                    await self.blobs.put_file(key, folder / CACHED_LINKS_FILE)
                info = await self.blobs.info(key)
            if info is None:
                raise Unavailable("storage-unavailable", "The file store has lost a file that was just stored.")
            return info

        return await self._links.get(key, make_meshes)

    async def reachability_json(self, name: str, measure: Measure | None) -> bytes:
        """``RobotReachability`` as gzipped JSON; ``measure`` None takes the default measure of plans.

        Raises the errors of ``facts``, ``NotFound`` (``reachability-not-learned``) and ``Unavailable``
        (``reachability-of-another-robot``).
        """
        facts = await self.facts(name)
        used = measure or facts.default_measure
        if used in facts.stale_measures:
            raise Unavailable(
                "reachability-of-another-robot",
                f"The {used} densities of {facts.title} were learned on another description of the robot than the "
                "installed one; learn them again (learn-reachability).",
            )
        if used not in facts.measures:
            available = ", ".join(facts.measures) or "none"
            raise NotFound(
                "reachability-not-learned",
                f"No densities of {facts.title} were learned under the measure {used}; available: {available}.",
            )

        async def make_reachability() -> bytes:
            key = f"{await self._key_prefix(name)}/{used}-{REACH_FILE}"
            stored = await self._read_stored(key)
            if stored is not None and await asyncio.to_thread(_is_whole, stored):
                return stored
            k, step = facts.measures.index(used), (1.0 - MESHES_FRACTION) / len(facts.measures)
            progress = self._progress_callback(name, MESHES_FRACTION + k * step, MESHES_FRACTION + (k + 1) * step)
            task = {"robot": name, "measure": used}
            async with self._run_child(self.enclose, task, REACH_TIMEOUT_S, progress) as (_, folder):
                compressed = (folder / REACH_FILE).read_bytes()
                await self._store_file(key, folder / REACH_FILE, compressed)
                return compressed

        return await self._reach.get(f"{name}/{used}", make_reachability)

    async def prepare(self, name: str) -> str | None:
        """Create the files of the robot ``name`` that do not exist; return the reason if that fails, else None.

        A failure is cached for ``RETRY_S``.
        """

        async def make_files() -> None:
            facts = await self.facts(name)
            await self.link_meshes(name)
            for measure in facts.measures:
                await self.reachability_json(name, measure)
            self._ready.add(name)

        if name in self._ready:
            return None
        return await self._prepared.get(name, lambda: self._try_loading(f"{name}/files", make_files))

    async def preparation_state(self, name: str) -> RobotPreparation:
        """State of the preparation of the robot ``name``, which is started if it is not running."""
        self._in_background.discard(name)
        waiting = asyncio.ensure_future(self.prepare(name))
        done, _ = await asyncio.wait({waiting}, timeout=STATUS_WAIT_S)
        if not done:
            waiting.cancel()  # the preparation itself goes on
            fraction, message = self._progress.get(name, (0.0, "waiting"))
            return RobotPreparation(state="preparing", fraction=fraction, message=message)
        reason = waiting.result()
        if reason is None:
            return RobotPreparation(state="ready", fraction=1.0, message="ready")
        return RobotPreparation(state="failed", fraction=0.0, message=reason)

    async def prepare_all(self, names: Iterable[str], before_next: Callable[[], Awaitable[None]] | None = None) -> None:
        """Prepare robots one after the other; a failure is reported when the robot is requested.

        The child processes of a robot have low priority until its preparation is requested. ``before_next`` is awaited
        before every robot but the first.
        """
        for k, name in enumerate(names):
            if k and before_next is not None:
                await before_next()
            self._in_background.add(name)
            try:
                await self.prepare(name)
            finally:
                self._in_background.discard(name)

    async def aclose(self) -> None:
        """Cancel the running computations and end their child processes."""
        for running in (self._prepared, self._facts, self._links, self._reach, self._prefixes):
            await running.aclose()
        await self._children.aclose()

    async def _try_loading(self, what: str, load: Callable[[], Awaitable[object]]) -> str | None:
        """Call ``load``, unless it failed within the last ``RETRY_S`` for ``what``; return the reason of a failure."""
        failed_s, reason = self._failed.get(what, (-RETRY_S, ""))
        if time.monotonic() - failed_s < RETRY_S:
            return reason
        try:
            await load()
        except StridelabError as error:
            self._failed[what] = (time.monotonic(), error.message)
            return error.message
        return None

    async def _key_prefix(self, name: str) -> str:
        """Key prefix of the files of a robot."""
        return await self._prefixes.get(name, lambda: asyncio.to_thread(cached_files_prefix, name))

    async def _read_stored(self, key: str) -> bytes | None:
        """Content of a stored file; None if it does not exist or the store does not answer."""
        try:
            return b"".join([chunk async for chunk in self.blobs.stream(key)])
        except NotFound:
            return None
        except Unavailable as error:
            log.warning("robot file not read", key=key, error=error.message)
            return None

    async def _store_file(self, key: str, path: Path, content: bytes) -> None:
        """Write ``content`` to ``path`` and publish it as ``key``; a store that does not answer is only logged."""
        path.write_bytes(content)
        try:
            await self.blobs.put_file(key, path)
        except Unavailable as error:
            log.warning("robot file not stored", key=key, error=error.message)

    def _run_child(
        self, target: str, task: dict[str, str], timeout_s: float, progress: Progress
    ) -> AbstractAsyncContextManager[tuple[dict[str, Any], Path]]:
        return self._children.run(target, task, timeout_s, progress, yields=task["robot"] in self._in_background)

    def _progress_callback(self, name: str, start: float, end: float) -> Progress:
        """Progress callback of a step that covers the fraction from ``start`` to ``end`` of the preparation."""

        def report_progress(fraction: float, message: str) -> None:
            self._progress[name] = (start + (end - start) * min(max(fraction, 0.0), 1.0), message)

        report_progress(0.0, "starting")
        return report_progress


def _is_whole(compressed: bytes) -> bool:
    try:
        return bool(gzip.decompress(compressed))
    except (OSError, EOFError, zlib.error):
        return False
