"""Work that several ask for at the same time, and that is done once.

What is known of each robot: made in killable children, stored under a hash of what it is made from.

Facts, display meshes and what can be drawn of densities are files of the store, below ``robots/<name>/<hash>``. Each is
published as a whole when it is complete. They are made at the first start of a service (``warm``), or for whoever asks
before; every later start finds them. The service itself never imports a rigid-body library.
"""

import asyncio
import gzip
import time
import zlib
from collections.abc import Awaitable, Callable, Iterable
from contextlib import AbstractAsyncContextManager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, Generic, TypeVar

import structlog
from pydantic import ValidationError

from stridelab.errors import NotFound, StridelabError, Unavailable
from stridelab.schemas.robots import Measure, RobotFacts, RobotPreparation
from stridelab.service.api.robots.children import DESCRIBE, LINKS, REACH, Progress, RobotChildren
from stridelab.service.api.robots.source_hash import source_sha256
from stridelab.service.processes.pool import IsolatedPool
from stridelab.service.processes.sandbox import STRICT, Sandbox
from stridelab.service.storage.blobs import BlobInfo, BlobStore

T = TypeVar("T")


class Once(Generic[T]):
    """One running piece of work per key, shared by all who wait for it; nobody who leaves takes it from the others.

    What has failed is tried again by the next who asks. With ``keep``, what has succeeded is never done again.
    """

    def __init__(self, *, keep: bool) -> None:
        self._keep = keep
        self._tasks: dict[str, asyncio.Task[T]] = {}

    async def get(self, key: str, work: Callable[[], Awaitable[T]]) -> T:
        """The result of ``work()``, of this call or of the one that is under way for ``key``."""
        task = self._tasks.get(key)
        if task is None:
            task = asyncio.ensure_future(_started(work))
            self._tasks[key] = task
            task.add_done_callback(lambda done: self._ended(key, done))
        return await asyncio.shield(task)

    async def aclose(self) -> None:
        """Cancel what is still under way."""
        waiting = list(self._tasks.values())
        for task in waiting:
            task.cancel()
        await asyncio.gather(*waiting, return_exceptions=True)

    def _ended(self, key: str, task: "asyncio.Task[T]") -> None:
        failed = task.cancelled() or task.exception() is not None
        if failed or not self._keep:
            del self._tasks[key]


async def _started(work: Callable[[], Awaitable[T]]) -> T:
    return await work()


log = structlog.get_logger(__name__)

FACTS_FILE: Final = "facts.json"
LINKS_FILE: Final = "links.glb"
REACH_FILE: Final = "reachability.json.gz"
DESCRIBE_TIMEOUT_S: Final = 60.0
LINKS_TIMEOUT_S: Final = 180.0
REACH_TIMEOUT_S: Final = 120.0
RETRY_S: Final = 60.0
"""For so long a robot that could not be loaded is said to be unavailable without another attempt."""
SHORTLY_S: Final = 0.5
"""How long a question about the preparation waits for one that only has to find the files."""
DESCRIBED, DRAWN = 0.3, 0.6
"""Shares of the preparation that are over when a robot is described, and when it is drawn."""


@dataclass(eq=False)
class RobotShelf:
    """What is known of the robots, for one application; ``describe``, ``draw`` and ``enclose`` are run by children."""

    pool: IsolatedPool
    blobs: BlobStore
    spool: Path
    memory_mb: int
    describe: str = DESCRIBE
    draw: str = LINKS
    enclose: str = REACH
    _places: Once[str] = field(default_factory=lambda: Once(keep=True))
    sandbox: Sandbox | None = STRICT
    _facts: Once[RobotFacts] = field(default_factory=lambda: Once(keep=True))
    _failed: dict[str, tuple[float, str]] = field(default_factory=dict)
    _links: Once[BlobInfo] = field(default_factory=lambda: Once(keep=False))
    _reach: Once[bytes] = field(default_factory=lambda: Once(keep=True))
    _prepared: Once[str | None] = field(default_factory=lambda: Once(keep=False))
    _ready: set[str] = field(default_factory=set)
    _progress: dict[str, tuple[float, str]] = field(default_factory=dict)
    _unasked: set[str] = field(default_factory=set)

    def __post_init__(self) -> None:
        self._children = RobotChildren(self.pool, self.spool, self.memory_mb, self.sandbox)

    async def facts(self, name: str) -> RobotFacts:
        """Facts of a known robot.

        Raises ``Unavailable`` (``robot-data-missing``, or ``robot-not-loaded`` where the child crashed or took too
        long).
        """

        async def load() -> RobotFacts:
            key = f"{await self._place(name)}/{FACTS_FILE}"
            with suppress(ValidationError):  # nothing is stored, or it is damaged
                return RobotFacts.model_validate_json(await self._stored(key) or b"")
            told = self._telling(name, 0.0, DESCRIBED)
            async with self._child(self.describe, {"robot": name}, DESCRIBE_TIMEOUT_S, told) as (value, folder):
                found = RobotFacts.model_validate(value["summary"])
                await self._store(key, folder / FACTS_FILE, found.model_dump_json().encode())
                return found

        return await self._facts.get(name, load)

    async def problem(self, name: str) -> str | None:
        """Why a known robot cannot be loaded here, ``None`` for one that can; the first question loads it.

        A failure is remembered for ``RETRY_S``.
        """
        return await self._attempt(name, lambda: self.facts(name))

    async def links(self, name: str) -> BlobInfo:
        """The file with one named mesh per link (GLB), made where it is not there yet; raises as ``facts``."""
        await self.facts(name)
        key = f"{await self._place(name)}/{LINKS_FILE}"

        async def make() -> BlobInfo:
            found = await self.blobs.info(key)
            if found is None:
                told = self._telling(name, DESCRIBED, DRAWN)
                async with self._child(self.draw, {"robot": name}, LINKS_TIMEOUT_S, told) as (_, folder):
                    await self.blobs.put_file(key, folder / LINKS_FILE)
                found = await self.blobs.info(key)
            if found is None:
                raise Unavailable("storage-unavailable", "The file storage has lost what it was just given.")
            return found

        return await self._links.get(key, make)

    async def reach(self, name: str, measure: Measure | None) -> bytes:
        """A ``RobotReachability`` as compressed JSON, under the measure that plans use where none is asked for.

        Raises as ``facts``, ``NotFound`` (``reachability-not-learned``) and ``Unavailable``
        (``reachability-of-another-robot``).
        """
        known = await self.facts(name)
        wanted = measure or known.default_measure
        if wanted in known.stale_measures:
            raise Unavailable(
                "reachability-of-another-robot",
                f"The {wanted} densities of {known.title} were learned on another description of the robot than the "
                "installed one; learn them anew (learn-reachability).",
            )
        if wanted not in known.measures:
            there = ", ".join(known.measures) or "none"
            raise NotFound(
                "reachability-not-learned",
                f"No densities of {known.title} were learned under the measure {wanted}; there is {there}.",
            )

        async def enclose() -> bytes:
            key = f"{await self._place(name)}/{wanted}-{REACH_FILE}"
            stored = await self._stored(key)
            if stored is not None and await asyncio.to_thread(_is_whole, stored):
                return stored
            k, step = known.measures.index(wanted), (1.0 - DRAWN) / len(known.measures)
            told = self._telling(name, DRAWN + k * step, DRAWN + (k + 1) * step)
            task = {"robot": name, "measure": wanted}
            async with self._child(self.enclose, task, REACH_TIMEOUT_S, told) as (_, folder):
                made = (folder / REACH_FILE).read_bytes()
                await self._store(key, folder / REACH_FILE, made)
                return made

        return await self._reach.get(f"{name}/{wanted}", enclose)

    async def prepare(self, name: str) -> str | None:
        """Make whatever of a known robot's files is not stored yet; why that fails, or None where it does not.

        A failure is remembered for ``RETRY_S``.
        """

        async def make() -> None:
            known = await self.facts(name)
            await self.links(name)
            for measure in known.measures:
                await self.reach(name, measure)
            self._ready.add(name)

        if name in self._ready:
            return None
        return await self._prepared.get(name, lambda: self._attempt(f"{name}/files", make))

    async def preparation(self, name: str) -> RobotPreparation:
        """How far the files of a known robot are; the first question begins to make what is missing."""
        self._unasked.discard(name)
        waiting = asyncio.ensure_future(self.prepare(name))
        done, _ = await asyncio.wait({waiting}, timeout=SHORTLY_S)
        if not done:
            waiting.cancel()  # the preparation itself goes on
            fraction, message = self._progress.get(name, (0.0, "waiting"))
            return RobotPreparation(state="preparing", fraction=fraction, message=message)
        reason = waiting.result()
        if reason is None:
            return RobotPreparation(state="ready", fraction=1.0, message="ready")
        return RobotPreparation(state="failed", fraction=0.0, message=reason)

    async def warm(self, names: Iterable[str]) -> None:
        """Prepare robots one after the other; what fails is told to whoever asks for it.

        The children of a robot have low priority until somebody asks for its preparation.
        """
        for name in names:
            self._unasked.add(name)
            try:
                await self.prepare(name)
            finally:
                self._unasked.discard(name)

    async def aclose(self) -> None:
        """End the children that are still at work."""
        for running in (self._prepared, self._facts, self._links, self._reach, self._places):
            await running.aclose()
        await self._children.aclose()

    async def _attempt(self, what: str, load: Callable[[], Awaitable[object]]) -> str | None:
        """Why ``load`` fails, or failed within the last ``RETRY_S`` for the same ``what``; None where it does not."""
        failed_s, reason = self._failed.get(what, (-RETRY_S, ""))
        if time.monotonic() - failed_s < RETRY_S:
            return reason
        try:
            await load()
        except StridelabError as error:
            self._failed[what] = (time.monotonic(), error.message)
            return error.message
        return None

    async def _place(self, name: str) -> str:
        """The prefix below which the files of a robot are stored."""

        async def read() -> str:
            return f"robots/{name}/{await asyncio.to_thread(source_sha256, name)}"

        return await self._places.get(name, read)

    async def _stored(self, key: str) -> bytes | None:
        """A stored file, or None; a store that does not answer is as good as empty, for what can be made anew."""
        try:
            return b"".join([chunk async for chunk in self.blobs.stream(key)])
        except NotFound:
            return None
        except Unavailable as error:
            log.warning("robot file not read", key=key, error=error.message)
            return None

    async def _store(self, key: str, path: Path, content: bytes) -> None:
        """Publish ``content``, written to ``path`` first; without the store, only this process has it."""
        path.write_bytes(content)
        try:
            await self.blobs.put_file(key, path)
        except Unavailable as error:
            log.warning("robot file not stored", key=key, error=error.message)

    def _child(
        self, target: str, task: dict[str, str], timeout_s: float, progress: Progress
    ) -> AbstractAsyncContextManager[tuple[dict[str, Any], Path]]:
        return self._children.run(target, task, timeout_s, progress, yields=task["robot"] in self._unasked)

    def _telling(self, name: str, start: float, end: float) -> Progress:
        """Takes the progress of one step, which is the share from ``start`` to ``end`` of the preparation."""

        def tell(fraction: float, message: str) -> None:
            self._progress[name] = (start + (end - start) * min(max(fraction, 0.0), 1.0), message)

        tell(0.0, "starting")
        return tell


def _is_whole(compressed: bytes) -> bool:
    try:
        return bool(gzip.decompress(compressed))
    except (OSError, EOFError, zlib.error):
        return False
