"""Content-addressed storage of uploads: identical files are stored once and deleted with their last recording.

A lock on the key prevents the deletion of a file that a concurrent upload of the same bytes is about to use.
"""

from datetime import UTC, datetime, timedelta
from typing import Final

from sqlalchemy import func, select
from sqlalchemy.ext.asyncio import AsyncConnection

from stridelab.service.storage.blobs import BlobStore
from stridelab.service.storage.tables import recording

UPLOAD_FOLDER: Final = "uploads"


def upload_key(sha256: str) -> str:
    """Blob key of the uploaded file with this hash."""
    return f"{UPLOAD_FOLDER}/{sha256}"


async def lock_blob(connection: AsyncConnection, blob_key: str) -> None:
    """Lock a blob against concurrent storing and removing until the connection's transaction ends."""
    await connection.execute(select(func.pg_advisory_xact_lock(func.hashtextextended(blob_key, 0))))


async def try_lock_blob(connection: AsyncConnection, blob_key: str) -> bool:
    """``lock_blob`` without waiting; False if another transaction holds the lock."""
    try_lock = select(func.pg_try_advisory_xact_lock(func.hashtextextended(blob_key, 0)))
    return bool((await connection.execute(try_lock)).scalar_one())


async def delete_if_unused(connection: AsyncConnection, blobs: BlobStore, blob_key: str) -> bool:
    """Delete the file unless a recording uses it, inside the caller's transaction; returns whether it was deleted."""
    await lock_blob(connection, blob_key)
    users = select(func.count()).where(recording.c.blob_key == blob_key)
    if (await connection.execute(users)).scalar_one() > 0:
        return False
    await blobs.delete(blob_key)
    return True


async def remove_unused(connection: AsyncConnection, blobs: BlobStore, age: timedelta) -> list[str]:
    """Delete uploads older than ``age`` that no recording uses (of processes that died); returns their keys."""
    now = datetime.now(UTC)
    old = [info.key async for info in blobs.list_prefix(UPLOAD_FOLDER) if now - info.modified_at > age]
    used = set((await connection.execute(select(recording.c.blob_key).where(recording.c.blob_key.in_(old)))).scalars())
    await connection.rollback()
    removed = []
    for key in sorted(set(old) - used):
        if await delete_if_unused(connection, blobs, key):
            removed.append(key)
        await connection.commit()
    return removed
