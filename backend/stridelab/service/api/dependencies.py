"""The caller of a request, as the gate has found it.

What the endpoints work with: one set of parts per application, made when it starts and closed when it ends.
"""

import asyncio
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Final

import anyio
from fastapi import Depends
from sqlalchemy.ext.asyncio import AsyncEngine
from starlette.requests import HTTPConnection

from stridelab.errors import NotFound
from stridelab.service.api.robots.cache import RobotShelf
from stridelab.service.api.stream.limits import StreamPlaces
from stridelab.service.auth.callers import STRANGER, Caller
from stridelab.service.auth.token_cache import TokenBook
from stridelab.service.jobs.notifications import JobBoard
from stridelab.service.jobs.store import JobStore
from stridelab.service.processes.pool import IsolatedPool
from stridelab.service.processes.resident import Resident
from stridelab.service.settings import Settings
from stridelab.service.storage.blobs import BlobStore

KEY: Final = "stridelab.caller"
"""Where in a request's scope the gate puts the caller."""


async def caller_of(connection: HTTPConnection) -> Caller:
    """Who calls; calls that did not pass the gate come from the pages.

    A coroutine, since FastAPI calls any other dependency in a thread.
    """
    caller = connection.scope.get(KEY, STRANGER)
    if not isinstance(caller, Caller):
        raise TypeError("the gate has put something else than a caller into the request")
    return caller


CallerOf = Annotated[Caller, Depends(caller_of)]


_ID: Final = re.compile(r"[A-Za-z0-9_-]{1,64}")


@dataclass(frozen=True)
class Parts:
    """Database, files, the board that says when a job changes, and the limits."""

    settings: Settings
    engine: AsyncEngine
    blobs: BlobStore
    store: JobStore
    board: JobBoard
    pool: IsolatedPool
    spool: Path
    parsers: anyio.CapacityLimiter
    batches: anyio.CapacityLimiter
    judges: anyio.CapacityLimiter
    tokens: TokenBook
    robots: RobotShelf
    resident: Resident
    bodies: Resident
    streams: StreamPlaces
    started_at_s: float
    closing: asyncio.Event
    """Set when the server has been told to stop."""


def parts_of(connection: HTTPConnection) -> Parts:
    """The parts of the application that was called."""
    parts = connection.app.state.parts
    if not isinstance(parts, Parts):
        raise TypeError("the application was called before it started")
    return parts


async def _parts(connection: HTTPConnection) -> Parts:
    return parts_of(connection)  # a dependency that is no coroutine would be called in a thread


AppParts = Annotated[Parts, Depends(_parts)]


def known_form(identifier: str, what: str) -> str:
    """``identifier`` if it can be the id of a ``what``. Raises ``NotFound`` (``<what>-not-found``)."""
    if not _ID.fullmatch(identifier):
        raise not_found(what)
    return identifier


def not_found(what: str) -> NotFound:
    """The error for an unknown ``what`` (recording, subject, job)."""
    return NotFound(f"{what}-not-found", f"There is no {what} with this id; it may have been deleted.")
