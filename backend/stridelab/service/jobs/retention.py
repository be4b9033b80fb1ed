"""Removes old events, old results, and files that no row refers to."""

from datetime import UTC, datetime, timedelta
from typing import Final

import structlog
from sqlalchemy import delete, exists, func, or_, select
from sqlalchemy.ext.asyncio import AsyncConnection, AsyncEngine

from stridelab.schemas.jobs import FINAL_STATES
from stridelab.service.auth import audit
from stridelab.service.jobs.partial_results import delete_stale_chunks
from stridelab.service.jobs.queue import attempt_prefix
from stridelab.service.kinds.read_batch import kind as read_batch
from stridelab.service.samples.recording import SHIPPED_JOBS
from stridelab.service.settings import Settings
from stridelab.service.storage import content_addressed, locks
from stridelab.service.storage.blobs import BlobStore
from stridelab.service.storage.tables import job, job_event, recording, robot, worker
from stridelab.service.stored_robots import ROBOT_FOLDER

ORPHAN_AGE: Final = timedelta(hours=1)
"""Minimum age of an orphan: younger files may belong to a row that is about to be written."""
_WORKER_AGE: Final = timedelta(days=1)
"""Age of the last heartbeat after which the row of a worker is removed."""
ROBOT_KEYS: Final = (robot.c.bundle_key, robot.c.links_key, robot.c.learned_key)
_log = structlog.get_logger(__name__)


async def remove_expired(engine: AsyncEngine, blobs: BlobStore, limits: Settings) -> None:
    """Remove all data past its retention time; no effect while another worker does so, or during a backup."""
    async with engine.connect() as connection:
        try:
            for lock in (func.pg_try_advisory_lock(locks.JANITOR), func.pg_try_advisory_lock_shared(locks.REMOVAL)):
                if not (await connection.execute(select(lock))).scalar_one():
                    return
            await remove_old_events(connection, timedelta(days=limits.event_retention_days))
            await remove_old_jobs(connection, blobs, timedelta(days=limits.result_retention_days))
            await audit.remove_old(connection, timedelta(days=limits.audit_retention_days))
            await remove_orphans(connection, blobs)
            await content_addressed.remove_unused(connection, blobs, ORPHAN_AGE)
            await remove_dead_workers(connection, _WORKER_AGE)
            await delete_stale_chunks(connection)
        finally:
            await connection.rollback()
            await connection.execute(select(func.pg_advisory_unlock_all()))
            await connection.commit()


async def remove_dead_workers(connection: AsyncConnection, age: timedelta) -> None:
    """Delete the rows of workers whose last heartbeat came more than ``age`` ago."""
    await connection.execute(delete(worker).where(worker.c.last_heartbeat < func.now() - age))
    await connection.commit()


async def remove_old_events(connection: AsyncConnection, age: timedelta) -> None:
    """Delete the events of jobs that ended more than ``age`` ago; the job's final state remains."""
    ended = select(job.c.id).where(job.c.state.in_(FINAL_STATES), job.c.finished_at < func.now() - age)
    await connection.execute(delete(job_event).where(job_event.c.job_id.in_(ended)))
    await connection.commit()


async def remove_old_jobs(connection: AsyncConnection, blobs: BlobStore, age: timedelta) -> list[str]:
    """Delete jobs that ended more than ``age`` ago, and then their files; returns their ids.

    Jobs of the bundled sample are never deleted; a job with the ground truth of a recording stays with the recording.
    """
    over = (job.c.state.in_(FINAL_STATES), job.c.finished_at < func.now() - age, job.c.id.not_in(SHIPPED_JOBS))
    is_truth = exists().where(recording.c.truth_job_id == job.c.id)
    old = delete(job).where(*over, ~is_truth)
    gone = list((await connection.execute(old.returning(job.c.id))).scalars())
    await connection.commit()
    for job_id in gone:
        await blobs.delete_prefix(f"results/{job_id}")
    return gone


async def remove_orphans(connection: AsyncConnection, blobs: BlobStore, age: timedelta = ORPHAN_AGE) -> list[str]:
    """Delete files older than ``age`` that no job and no recording refers to; returns the prefixes and the keys.

    An uncommitted transaction may refer to such a file. The job's row is then still ``running`` in the attempt of the
    prefix; the key of a recording's file is locked (``lock_blob``).
    """
    results = await _old_prefixes(blobs, "results", 3, age)
    batches = await _old_prefixes(blobs, read_batch.BATCH_FOLDER, 2, age)
    robots = await _old_prefixes(blobs, ROBOT_FOLDER, 3, age)
    recordings = await _old_prefixes(blobs, "recordings", 3, age)  # full keys: tracks of a recording may be replaced
    # rows are read after the files, so that rows written in between are included
    columns = (job.c.id, job.c.attempt, job.c.started_at, job.c.state, job.c.blob_prefix)
    rows = (await connection.execute(select(*columns))).all()
    referred = {row.blob_prefix for row in rows}
    referred |= {attempt_prefix(row.id, row.attempt, row.started_at) for row in rows if row.state == "running"}
    unread = select(job.c.input).where(job.c.kind == read_batch.READ_BATCH_KIND, job.c.state.not_in(FINAL_STATES))
    referred |= {read_batch.batch_prefix(job_input) for job_input in (await connection.execute(unread)).scalars()}
    files = (await connection.execute(select(recording.c.blob_key, recording.c.tracks_key))).all()
    of_robots = (await connection.execute(select(*ROBOT_KEYS))).all()
    await connection.rollback()
    prefixes, keys = (
        sorted((results | batches) - referred),
        sorted((recordings | robots) - {key for row in (*files, *of_robots) for key in row}),
    )
    for prefix in prefixes:
        await blobs.delete_prefix(prefix)
    removed = [key for key in keys if await _remove_unnamed(connection, blobs, key)]
    if prefixes or removed:
        _log.info("orphaned-files-removed", results=len(prefixes), files=len(removed))
    return prefixes + removed


async def _remove_unnamed(connection: AsyncConnection, blobs: BlobStore, key: str) -> bool:
    """Delete a file of a recording or a robot unless a row refers to it or its key is locked; returns whether."""
    of_recording = exists().where(or_(recording.c.blob_key == key, recording.c.tracks_key == key))
    of_robot = exists().where(or_(*(column == key for column in ROBOT_KEYS)))
    named = or_(of_recording, of_robot)
    try:
        if (
            not await content_addressed.try_lock_blob(connection, key)
            or (await connection.execute(select(named))).scalar_one()
        ):
            return False
        await blobs.delete(key)
        return True
    finally:
        await connection.rollback()


async def _old_prefixes(blobs: BlobStore, root: str, depth: int, age: timedelta) -> set[str]:
    """Prefixes of ``depth`` segments below ``root`` whose newest file is older than ``age``."""
    newest: dict[str, datetime] = {}
    async for info in blobs.list_prefix(root):
        prefix = "/".join(info.key.split("/")[:depth])
        newest[prefix] = max(newest.get(prefix, info.modified_at), info.modified_at)
    now = datetime.now(UTC)
    return {prefix for prefix, written_at in newest.items() if now - written_at > age}
