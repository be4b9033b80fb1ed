"""What is known of each robot: computed in a killable child when first asked for, then kept.

Facts and what can be drawn of densities are kept in memory, display meshes as a file. The service itself never
imports a rigid-body library.
"""

import tempfile
import time
from collections.abc import AsyncIterator, Iterable
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import structlog

from stridelab.errors import NotFound, StridelabError, Unavailable
from stridelab.schemas.robots import Measure, RobotFacts
from stridelab.service.api.robots.once import Once
from stridelab.service.jobs.isolated import IsolatedPool
from stridelab.service.storage.blobs import BlobInfo, BlobStore

log = structlog.get_logger(__name__)

DESCRIBE: Final = "stridelab.service.jobs.kinds.robot_description:run_in_child"
LINKS: Final = "stridelab.service.jobs.kinds.robot_links:run_in_child"
REACH: Final = "stridelab.service.jobs.kinds.robot_reachability:run_in_child"
LINKS_FILE: Final = "links.glb"
REACH_FILE: Final = "reachability.json.gz"
LINKS_EDITION: Final = 2
"""Grows whenever the shapes are made in another way, so that no older file is served."""
DESCRIBE_TIMEOUT_S: Final = 60.0
LINKS_TIMEOUT_S: Final = 180.0
REACH_TIMEOUT_S: Final = 120.0
RETRY_S: Final = 60.0
"""For so long a robot that could not be loaded is said to be unavailable without another attempt."""


@dataclass(frozen=True)
class RobotShelf:
    """What is known of the robots, for one application; ``describe``, ``draw`` and ``enclose`` are run by children."""

    pool: IsolatedPool
    blobs: BlobStore
    spool: Path
    memory_mb: int
    describe: str = DESCRIBE
    draw: str = LINKS
    enclose: str = REACH
    _facts: Once[RobotFacts] = field(default_factory=lambda: Once(keep=True))
    _failed: dict[str, tuple[float, str]] = field(default_factory=dict)
    _links: Once[BlobInfo] = field(default_factory=lambda: Once(keep=False))
    _reach: Once[bytes] = field(default_factory=lambda: Once(keep=True))

    async def facts(self, name: str) -> RobotFacts:
        """Facts of a known robot.

        Raises ``Unavailable`` (``robot-data-missing``, or ``robot-not-loaded`` where the child crashed or took too
        long).
        """

        async def load() -> RobotFacts:
            async with self._child(self.describe, {"robot": name}, DESCRIBE_TIMEOUT_S) as (value, _):
                return RobotFacts.model_validate(value["summary"])

        return await self._facts.get(name, load)

    async def problem(self, name: str) -> str | None:
        """Why a known robot cannot be loaded here, ``None`` for one that can; the first question loads it.

        A failure is remembered for ``RETRY_S``.
        """
        failed_s, reason = self._failed.get(name, (-RETRY_S, ""))
        if time.monotonic() - failed_s < RETRY_S:
            return reason
        try:
            await self.facts(name)
        except StridelabError as error:
            self._failed[name] = (time.monotonic(), error.message)
            return error.message
        return None

    async def links(self, name: str) -> BlobInfo:
        """The file with one named mesh per link (GLB), made where it is not there yet; raises as ``facts``."""
        key = f"robots/{name}/{(await self.facts(name)).sha256}/{LINKS_EDITION}/{LINKS_FILE}"

        async def make() -> BlobInfo:
            found = await self.blobs.info(key)
            if found is None:
                async with self._child(self.draw, {"robot": name}, LINKS_TIMEOUT_S) as (_, folder):
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
            task = {"robot": name, "measure": wanted}
            async with self._child(self.enclose, task, REACH_TIMEOUT_S) as (_, folder):
                return (folder / REACH_FILE).read_bytes()

        return await self._reach.get(f"{name}/{wanted}", enclose)

    async def warm(self, names: Iterable[str], others: Iterable[str] = ()) -> None:
        """Facts and meshes of robots that will be asked for, and whether the ``others`` can be loaded.

        What cannot be had is told to whoever asks for it.
        """
        for name in names:
            with suppress(StridelabError):
                await self.links(name)
        for name in others:
            await self.problem(name)

    async def aclose(self) -> None:
        """End the children that are still at work."""
        await self._facts.aclose()
        await self._links.aclose()
        await self._reach.aclose()

    @asynccontextmanager
    async def _child(
        self, target: str, task: dict[str, str], timeout_s: float
    ) -> AsyncIterator[tuple[dict[str, Any], Path]]:
        """What ``target`` returned for a task about a robot, and the folder with the files it left, for a moment."""
        with tempfile.TemporaryDirectory(dir=self.spool) as folder:
            outcome = await self.pool.run(target, task, Path(folder), timeout_s=timeout_s, memory_mb=self.memory_mb)
            if outcome.raised is not None:
                raise outcome.as_error()
            if outcome.state != "ok":
                log.error("robot not loaded", **task, state=outcome.state, log_tail=outcome.log_tail[-2000:])
                raise Unavailable(
                    "robot-not-loaded",
                    f"The model of {task['robot']} could not be loaded; the service's log says more.",
                )
            yield outcome.value, Path(folder)
