"""Deletion of finished jobs with their files, and of the studies that contain data of a subject."""

from collections.abc import Sequence
from typing import Final

from sqlalchemy import delete, or_, select

from stridelab.errors import Conflict, Forbidden, NotFound
from stridelab.schemas.jobs import FINAL_STATES
from stridelab.service.api.dependencies import Parts
from stridelab.service.auth import audit
from stridelab.service.auth.callers import Caller, require_owner
from stridelab.service.jobs.store import JobRecord
from stridelab.service.kinds.registry import KINDS
from stridelab.service.samples.recording import SHIPPED_JOBS
from stridelab.service.storage.file_removal import may_remove
from stridelab.service.storage.tables import job, recording

REMAINING_JOBS_HEADER: Final = "Stridelab-Kept-In"
"""Response header of a deletion: ids of the jobs whose inputs and results still contain the deleted data."""
RECORDING_LISTS: Final = ("recording_ids", "reference_recording_ids", "before_recording_ids")
"""Fields of job inputs that list recordings; a test compares them with the input models of all kinds."""


async def delete_finished(parts: Parts, job_id: str, caller: Caller) -> None:
    """Delete a finished job with its result and files.

    Raises ``NotFound`` (``job-not-found``), ``Forbidden`` (``not-owner``), ``Conflict``: ``bundled-read-only`` for a
    result that is part of the program, ``job-not-finished``, ``job-holds-truth`` if a recording refers to it.
    """
    if job_id in SHIPPED_JOBS:
        raise Conflict("bundled-read-only", "This result comes with the program and cannot be deleted.")
    async with parts.engine.begin() as connection:
        query = select(job.c.state, job.c.owner).where(job.c.id == job_id).with_for_update()
        row = (await connection.execute(query)).one_or_none()
        if row is None:
            raise NotFound("job-not-found", f"There is no job {job_id}; it may have been deleted already.")
        require_owner(caller, row.owner, "job")
        if row.state not in FINAL_STATES:
            raise Conflict("job-not-finished", f"Job {job_id} is still {row.state}; cancel it first.")
        truth_of = select(recording.c.id).where(recording.c.truth_job_id == job_id).limit(1)
        needed_by = (await connection.execute(truth_of)).scalar_one_or_none()
        if needed_by is not None:
            raise Conflict(
                "job-holds-truth",
                f"This job holds the true motion of the simulated recording {needed_by}; delete the recording first.",
            )
        await connection.execute(delete(job).where(job.c.id == job_id))
        await audit.record_action(connection, caller, "job-deleted", job_id)
    async with parts.engine.begin() as connection:
        if await may_remove(connection):  # otherwise the janitor removes them later
            await parts.blobs.delete_prefix(f"results/{job_id}")


async def remove_own_files(parts: Parts, record: JobRecord) -> None:
    """Remove the stored input files of a job that was cancelled before it ran; otherwise the worker removes them."""
    kind = KINDS.get(record.kind)
    if record.state != "cancelled" or kind is None or kind.own_files is None:
        return
    async with parts.engine.begin() as connection:
        if await may_remove(connection):  # otherwise the janitor removes them later
            await parts.blobs.delete_prefix(kind.own_files(record.input))


async def studies_of(parts: Parts, recording_ids: Sequence[str]) -> list[str]:
    """Ids of the jobs on several recordings that include one of ``recording_ids``.

    Their inputs and results contain data of the subjects. Jobs that read bulk uploads are included.
    """
    if not recording_ids:
        return []
    places = (*(job.c.input[name] for name in RECORDING_LISTS), job.c.result["summary"]["recording_ids"])
    named = or_(*(place.contains([recording_id]) for place in places for recording_id in recording_ids))
    async with parts.engine.connect() as connection:
        return list((await connection.execute(select(job.c.id).where(named).order_by(job.c.id))).scalars())


async def delete_studies(parts: Parts, job_ids: Sequence[str], caller: Caller) -> list[str]:
    """Delete the jobs that have finished and that the caller may delete; return the ids of the others."""
    remaining = []
    for job_id in job_ids:
        try:
            await delete_finished(parts, job_id, caller)
        except NotFound:
            continue
        except (Conflict, Forbidden):
            remaining.append(job_id)
    return remaining
