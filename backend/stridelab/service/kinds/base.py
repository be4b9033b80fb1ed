"""Definition of a job kind: metadata and three functions, one of them run in a killable child process.

``stage`` (worker, light) -> ``run`` (child, heavy, without database and storage) -> ``publish`` (worker, inside the
fenced transaction that makes the result visible). The command line uses the same ``run``.
"""

from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Protocol, TypeAlias, runtime_checkable

from stridelab.errors import StridelabError, problem_of
from stridelab.schemas.base import Contract

if TYPE_CHECKING:  # a command needs neither
    from sqlalchemy.ext.asyncio import AsyncConnection

    from stridelab.service.processes.sandbox import Sandbox

Json = dict[str, Any]
"""A JSON object."""


@runtime_checkable
class Blobs(Protocol):
    """The part of the blob store that job kinds need."""

    async def get_file(self, key: str, path: Path, sha256: str | None = None) -> Any:
        """Write the blob ``key`` into the file ``path``; raises if its hash differs from ``sha256``."""

    async def put_file(self, key: str, path: Path) -> Any:
        """Store the file ``path`` as blob ``key``."""

    async def keep_or_replace(self, key: str, path: Path, sha256: str) -> Any:
        """Store the file ``path`` as blob ``key`` unless the blob exists with this content."""

    async def info(self, key: str) -> Any:
        """Size and time of the blob ``key``; None if it does not exist."""

    async def exists(self, key: str) -> bool:
        """Whether the blob ``key`` exists."""
        ...


@dataclass(frozen=True)
class ArtifactFile:
    """A result file that a run has written to its folder."""

    name: str
    media_type: str


@dataclass(frozen=True)
class Outcome:
    """Return value of a run: the summary of the contract, citation keys, and the result files.

    With ``failure`` the job fails with this error and the rest is stored as a partial result.
    """

    summary: Json
    references: tuple[str, ...]
    artifacts: tuple[ArtifactFile, ...]
    failure: StridelabError | None = None

    def to_json(self) -> Json:
        """JSON form for the transfer from the child process; a failure becomes ``problem``."""
        value: Json = {
            "summary": self.summary,
            "references": list(self.references),
            "artifacts": [{"name": a.name, "media_type": a.media_type} for a in self.artifacts],
        }
        return value if self.failure is None else value | {"problem": problem_of(self.failure)}


Stage: TypeAlias = "Callable[[AsyncConnection, Blobs, Any, Path], Awaitable[Json]]"
"""``stage(connection, blobs, input, folder) -> task``: fetch rows and blob files for a valid input into ``folder``."""
StageLater: TypeAlias = "Callable[[Blobs, Json, Path], Awaitable[None]]"
"""``stage_later(blobs, task, folder)``: called beside the run, and cancelled when that ends."""
Publish: TypeAlias = "Callable[[AsyncConnection, Blobs, Mapping[str, Any], Json, Path], Awaitable[Json | None]]"
"""``publish(connection, blobs, job_row, outcome, folder) -> summary``: called inside the fenced transaction, before
the job row is set to succeeded; ``folder`` still contains the artifacts; a returned summary replaces the outcome's."""


def _strict() -> "Sandbox":
    from stridelab.service.processes.sandbox import STRICT

    return STRICT


@dataclass(frozen=True)
class JobKind:
    """One kind of job.

    ``title`` is its name for people, ``description`` the sentences of the HTTP documentation, and ``examples`` are
    requests by name, as ``{"summary": ..., "value": ...}`` of OpenAPI. ``run`` is an import path ``"module:function"``,
    by default of ``run`` in the module ``run`` of the kind's folder. A child process calls it with JSON on both sides
    (``processes.child.with_json``) as ``f(task, folder, progress)``; it returns an ``Outcome`` and writes its files to
    ``folder``. Limits of ``None`` are those of the settings. A kind that is not ``offered`` has no API call of its own;
    another call submits it. ``own_files`` maps a job's input to the key prefix of files that only this job needs: they
    are removed when it has ended. ``sandbox`` restricts the child; None, for a kind that reads no uploaded files, is
    unrestricted. A kind that ``spans_nodes`` may connect to the scheduler of ``STRIDELAB_DASK_URL``; one
    that ``shows_parts`` writes parts of its result while it is computed (``partial_results``). ``stage_later`` fetches
    files that a run uses only if they are there in time.
    """

    name: str
    title: str
    description: str
    input_model: type[Contract]
    summary_model: type[Contract]
    stage: Stage
    run: str = ""
    stage_later: "StageLater | None" = None
    examples: Mapping[str, Any] = field(default_factory=dict)
    publish: "Publish | None" = None
    timeout_s: float | None = None
    memory_mb: int | None = None
    lane: Literal["short", "long"] = "short"
    offered: bool = True
    own_files: Callable[[Mapping[str, Any]], str] | None = None
    sandbox: "Sandbox | None" = field(default_factory=_strict)
    spans_nodes: bool = False
    shows_parts: bool = False

    def __post_init__(self) -> None:
        own = f"stridelab.service.kinds.{self.name.replace('-', '_')}.run:run"
        object.__setattr__(self, "run", self.run or own)
