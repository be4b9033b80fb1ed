"""Audit log: a log line and a row of an append-only table per action; old rows are removed by retention.

The log contains the id of the caller's token, the table its name. Neither contains secrets.
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
    "marker-set-added",
    "marker-set-deleted",
    "robot-added",
    "robot-card-changed",
    "robot-deleted",
]
CONSOLE: Final = Caller("console", "admin", "console")
"""Caller of commands that access the database directly."""
_log = structlog.get_logger(__name__)


async def record_action(connection: AsyncConnection, caller: Caller, action: Action, what: str | None = None) -> None:
    """Record that ``caller`` did ``action`` on ``what`` (an id or a code), in the transaction of the action."""
    log_action(caller, action, what)
    await write_row(connection, caller, action, what)


async def write_row(connection: AsyncConnection, caller: Caller, action: Action, what: str | None) -> None:
    """Write the row of the table only."""
    row = {"id": uuid.uuid4().hex, "action": action, "caller": caller.name, "what": what}
    await connection.execute(insert(audit).values(row))


def log_action(caller: Caller, action: Action, what: str | None) -> None:
    """Write the log line only."""
    _log.info("audit", action=action, caller=caller.token_id, what=what)


async def remove_old(connection: AsyncConnection, age: timedelta) -> None:
    """Delete entries that are older than ``age``."""
    await connection.execute(delete(audit).where(audit.c.created_at < func.now() - age))
    await connection.commit()
