"""What the endpoints work with: one set of parts per application, made when it starts and closed when it ends."""

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
from stridelab.service.access.book import TokenBook
from stridelab.service.api.plans.resident import Resident
from stridelab.service.api.robots.shelf import RobotShelf
from stridelab.service.api.stream.limits import StreamPlaces
from stridelab.service.jobs.board import JobBoard
from stridelab.service.jobs.isolated import IsolatedPool
from stridelab.service.jobs.store import JobStore
from stridelab.service.settings import Settings
from stridelab.service.storage.blobs import BlobStore

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
