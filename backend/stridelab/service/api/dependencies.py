"""FastAPI dependencies: the authenticated caller of a request, and the resources that the endpoints share."""

import asyncio
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Final

import anyio
from fastapi import Depends
from sqlalchemy import Select
from sqlalchemy.ext.asyncio import AsyncConnection, AsyncEngine
from starlette.requests import HTTPConnection

from stridelab.errors import NotFound
from stridelab.service.api.live.rooms import LiveRooms
from stridelab.service.api.previews.own_robots import OwnRobotPlanners
from stridelab.service.api.robots.cache import RobotCache
from stridelab.service.api.scenarios.stored_checks import StoredChecks
from stridelab.service.api.stream.limits import StreamLimiter
from stridelab.service.api.stream.watching import LiveBoard
from stridelab.service.auth.callers import UNAUTHENTICATED, Caller
from stridelab.service.auth.token_cache import TokenCache
from stridelab.service.jobs.notifications import JobNotifications
from stridelab.service.jobs.store import JobStore
from stridelab.service.processes.pool import IsolatedPool
from stridelab.service.processes.resident import PreviewProcess
from stridelab.service.settings import Settings
from stridelab.service.storage.blobs import BlobStore

CALLER_KEY: Final = "stridelab.caller"
"""Key of the caller in the ASGI scope; set by the authentication middleware."""


async def caller_of(connection: HTTPConnection) -> Caller:
    """Caller of the request; unauthenticated for internal requests of the web pages, which skip the middleware.

    A coroutine, because FastAPI runs other dependencies in a thread.
    """
    caller = connection.scope.get(CALLER_KEY, UNAUTHENTICATED)
    if not isinstance(caller, Caller):
        raise TypeError("the ASGI scope holds something other than a Caller")
    return caller


CallerOf = Annotated[Caller, Depends(caller_of)]


_ID: Final = re.compile(r"[A-Za-z0-9_-]{1,64}")


@dataclass(frozen=True)
class Parts:
    """Resources of one application, opened at start-up: database, file store, notifications, processes, limits."""

    settings: Settings
    engine: AsyncEngine
    blobs: BlobStore
    store: JobStore
    notifications: JobNotifications
    pool: IsolatedPool
    spool: Path
    parsers: anyio.CapacityLimiter
    batches: anyio.CapacityLimiter
    robot_readers: anyio.CapacityLimiter
    terrain_readers: anyio.CapacityLimiter
    validation_limiter: anyio.CapacityLimiter
    tokens: TokenCache
    robots: RobotCache
    resident: PreviewProcess
    stance_checker: PreviewProcess
    own_planners: OwnRobotPlanners
    stored_checks: StoredChecks
    streams: StreamLimiter
    live: LiveBoard
    rooms: LiveRooms
    started_at_s: float
    closing: asyncio.Event
    """Set when the server begins to shut down."""


def parts_of(connection: HTTPConnection) -> Parts:
    """Resources of the application that handles ``connection``."""
    parts = connection.app.state.parts
    if not isinstance(parts, Parts):
        raise TypeError("the application was called before it started")
    return parts


async def _parts_dependency(connection: HTTPConnection) -> Parts:
    return parts_of(connection)  # FastAPI would run a plain function in a thread


AppParts = Annotated[Parts, Depends(_parts_dependency)]


def require_id_form(identifier: str, what: str) -> str:
    """Return ``identifier`` if it is well-formed. Raises ``NotFound`` (``<what>-not-found``) otherwise."""
    if not _ID.fullmatch(identifier):
        raise not_found_error(what)
    return identifier


async def required_row(connection: AsyncConnection, query: Select[Any], what: str) -> dict[str, Any]:
    """The row of ``query``. Raises ``NotFound`` (``<what>-not-found``) if there is none."""
    row = (await connection.execute(query)).mappings().one_or_none()
    if row is None:
        raise not_found_error(what)
    return dict(row)


def not_found_error(what: str) -> NotFound:
    """Error for an unknown ``what`` (recording, subject, job)."""
    return NotFound(f"{what}-not-found", f"There is no {what} with this id; it may have been deleted.")
