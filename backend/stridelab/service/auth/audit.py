"""Who did what: a line in the log, and a row in a table that cannot be changed, only removed when its time is over.

The log has the id of the caller's token, the table also its name. Nothing here holds a secret.
"""

import uuid
from datetime import timedelta
from typing import Final, Literal

import structlog
from sqlalchemy import delete, func, insert
from sqlalchemy.ext.asyncio import AsyncConnection

from stridelab.service.auth.callers import Caller
from stridelab.service.storage.tables import audit

Action = Literal[
    "token-created",
    "token-revoked",
    "login",
    "refused",
    "job-cancelled",
    "job-deleted",
    "recording-deleted",
    "subject-deleted",
    "scenario-deleted",
    "scenario-replaced",
]
CONSOLE: Final = Caller("console", "admin", "console")
"""Whoever types commands where the database can be reached."""
_log = structlog.get_logger(__name__)


async def note(connection: AsyncConnection, caller: Caller, action: Action, what: str | None = None) -> None:
    """Write that ``caller`` did ``action`` to ``what`` (an id or a code), in the transaction in which it is done."""
    tell(caller, action, what)
    await write(connection, caller, action, what)


async def write(connection: AsyncConnection, caller: Caller, action: Action, what: str | None) -> None:
    """Only the row in the table."""
    row = {"id": uuid.uuid4().hex, "action": action, "caller": caller.name, "what": what}
    await connection.execute(insert(audit).values(row))


def tell(caller: Caller, action: Action, what: str | None) -> None:
    """Only the line in the log."""
    _log.info("audit", action=action, caller=caller.token_id, what=what)


async def remove_old(connection: AsyncConnection, age: timedelta) -> None:
    """Delete entries that are older than ``age``."""
    await connection.execute(delete(audit).where(audit.c.created_at < func.now() - age))
    await connection.commit()
