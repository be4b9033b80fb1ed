"""Uploaded files are kept by content: a file that comes twice is stored once, and goes with its last recording.

A lock on the key keeps a deletion from taking away what an upload of the same bytes is just about to use.
"""

from datetime import UTC, datetime, timedelta
from typing import Final

from sqlalchemy import func, select
from sqlalchemy.ext.asyncio import AsyncConnection

from stridelab.service.storage.blobs import BlobStore
from stridelab.service.storage.tables import recording

FOLDER: Final = "uploads"


def upload_key(sha256: str) -> str:
    """Where the uploaded file with this hash lies."""
    return f"{FOLDER}/{sha256}"


async def lock_blob(connection: AsyncConnection, blob_key: str) -> None:
    """Keep others from storing or removing the same file until the connection's transaction ends."""
    await connection.execute(select(func.pg_advisory_xact_lock(func.hashtextextended(blob_key, 0))))


async def try_lock_blob(connection: AsyncConnection, blob_key: str) -> bool:
    """``lock_blob``, or False at once where somebody else holds the lock."""
    asked = select(func.pg_try_advisory_xact_lock(func.hashtextextended(blob_key, 0)))
    return bool((await connection.execute(asked)).scalar_one())


async def delete_if_unused(connection: AsyncConnection, blobs: BlobStore, blob_key: str) -> bool:
    """Delete the file unless a recording uses it, inside the caller's transaction; returns whether it was deleted."""
    await lock_blob(connection, blob_key)
    users = select(func.count()).where(recording.c.blob_key == blob_key)
    if (await connection.execute(users)).scalar_one() > 0:
        return False
    await blobs.delete(blob_key)
    return True


async def remove_unused(connection: AsyncConnection, blobs: BlobStore, age: timedelta) -> list[str]:
    """Delete uploads older than ``age`` that no recording uses (their process died on the way); returns their keys."""
    now = datetime.now(UTC)
    old = [info.key async for info in blobs.list_prefix(FOLDER) if now - info.modified_at > age]
    used = set((await connection.execute(select(recording.c.blob_key).where(recording.c.blob_key.in_(old)))).scalars())
    await connection.rollback()
    removed = []
    for key in sorted(set(old) - used):
        if await delete_if_unused(connection, blobs, key):
            removed.append(key)
        await connection.commit()
    return removed
