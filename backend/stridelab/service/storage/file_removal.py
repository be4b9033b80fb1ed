"""Prevents the removal of files during a backup, which needs every file that its rows refer to.

Processes that remove files hold a shared lock until the end of their transaction; a backup holds it exclusively. Files
that could not be removed have no row any more and are removed later by the janitor.
"""

from sqlalchemy import func, select
from sqlalchemy.ext.asyncio import AsyncConnection

from stridelab.service.storage import locks


async def may_remove(connection: AsyncConnection) -> bool:
    """Acquire the shared removal lock until the transaction of ``connection`` ends; False during a backup."""
    result = await connection.execute(select(func.pg_try_advisory_xact_lock_shared(locks.REMOVAL)))
    return bool(result.scalar_one())
