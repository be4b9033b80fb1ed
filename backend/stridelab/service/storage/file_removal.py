"""Files go only while nobody copies all of them: a backup needs every file that its rows name.

Whoever removes files asks first and holds the right until the end of a transaction; many may at once. A backup takes
it from all. What could not be removed then has no row any more, and is left to the janitor.
"""

from sqlalchemy import func, select
from sqlalchemy.ext.asyncio import AsyncConnection

from stridelab.service.storage import locks


async def may_remove(connection: AsyncConnection) -> bool:
    """Whether files may be removed; if so, until the transaction of ``connection`` ends."""
    asked = await connection.execute(select(func.pg_try_advisory_xact_lock_shared(locks.REMOVAL)))
    return bool(asked.scalar_one())
