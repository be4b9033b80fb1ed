"""A recording's row and its files belong together: no row without files, no files that nobody needs."""

import uuid
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import structlog
from sqlalchemy import delete, insert, select, update

from stridelab.errors import Conflict
from stridelab.schemas.jobs import FINAL_STATES
from stridelab.schemas.recordings import Recording, SubjectFields
from stridelab.service.access import audit
from stridelab.service.access.callers import Caller, require_owner
from stridelab.service.api.parts import Parts
from stridelab.service.api.quotas import refuse_full
from stridelab.service.api.recordings.multipart import ReceivedForm
from stridelab.service.api.recordings.parsing import NO_SWITCHES, Parsed, Switches
from stridelab.service.api.recordings.rows import recording_of, recording_row
from stridelab.service.storage.removal import may_remove
from stridelab.service.storage.tables import job, recording
from stridelab.service.storage.uploads import delete_if_unused, lock_blob, upload_key

log = structlog.get_logger(__name__)


def own_prefix(recording_id: str) -> str:
    """Below this lie the files that only this recording has."""
    return f"recordings/{recording_id}"


async def store_upload(
    parts: Parts, form: ReceivedForm, parsed: Parsed, subject: SubjectFields, owner: str | None
) -> Recording:
    """Store a parsed upload: both files, then the row, or nothing.

    Raises ``TooLarge`` (``storage-limit``) where ``owner`` has no room left for it.
    """
    await refuse_full(parts, owner, form.size_bytes)
    recording_id = uuid.uuid4().hex
    tracks_key = _tracks_key(recording_id)
    values = {
        "id": recording_id,
        "owner": owner,
        "filename": form.filename,
        "sha256": form.sha256,
        "bytes": form.size_bytes,
        "blob_key": upload_key(form.sha256),
        "tracks_key": tracks_key,
        "facts": parsed.facts.model_dump(mode="json"),
        "subject_fields": subject.model_dump(mode="json", exclude_none=True),
        **NO_SWITCHES.to_columns(),
    }
    try:
        async with parts.engine.begin() as connection:
            await lock_blob(connection, values["blob_key"])
            await parts.blobs.put_file(tracks_key, parsed.tracks)
            if not await parts.blobs.exists(values["blob_key"]):
                await parts.blobs.put_file(values["blob_key"], form.path)
            await connection.execute(insert(recording).values(values))
            return recording_of(await recording_row(connection, recording_id))
    except BaseException:
        await _discard(parts, recording_id, values["blob_key"])
        raise


async def replace_facts(
    parts: Parts,
    before: Mapping[str, Any],
    switches: Switches,
    parsed: Parsed,
    changes: Callable[[Mapping[str, Any]], Mapping[str, Any]],
) -> None:
    """Put facts and tracks parsed with new switches in place of the old ones, with ``changes`` of the locked row.

    Raises ``Conflict`` (``changed-meanwhile``) where somebody else changed the switches since ``before`` was read.
    """
    tracks_key = _tracks_key(before["id"])
    await parts.blobs.put_file(tracks_key, parsed.tracks)
    superseded = tracks_key
    try:
        async with parts.engine.begin() as connection:
            row = await recording_row(connection, before["id"], lock=True)
            if row["tracks_key"] != before["tracks_key"]:
                raise Conflict("changed-meanwhile", "The recording was changed by somebody else meanwhile; try again.")
            values = {
                **changes(row),
                **switches.to_columns(),
                "facts": parsed.facts.model_dump(mode="json"),
                "tracks_key": tracks_key,
            }
            await connection.execute(update(recording).where(recording.c.id == before["id"]).values(values))
        superseded = before["tracks_key"]
    finally:
        async with parts.engine.begin() as connection:
            if await may_remove(connection):
                await parts.blobs.delete(superseded)


async def delete_recording(parts: Parts, recording_id: str, caller: Caller) -> None:
    """Delete a recording with its jobs, results and files; running jobs are cancelled.

    Raises ``NotFound`` (``recording-not-found``), ``Conflict`` (``bundled-read-only``), ``Forbidden`` (``not-owner``).
    """
    async with parts.engine.connect() as connection:
        row = await recording_row(connection, recording_id)
        refuse_bundled(row)
        require_owner(caller, row["owner"], "recording")
        unfinished = select(job.c.id).where(job.c.recording_id == recording_id, job.c.state.not_in(FINAL_STATES))
        for job_id in (await connection.execute(unfinished)).scalars().all():
            await parts.store.request_cancel(job_id)
    async with parts.engine.begin() as connection:
        row = await recording_row(connection, recording_id, lock=True)
        jobs = (await connection.execute(select(job.c.id).where(job.c.recording_id == recording_id))).scalars().all()
        await connection.execute(delete(recording).where(recording.c.id == recording_id))
        await audit.note(connection, caller, "recording-deleted", recording_id)
    await _discard(parts, recording_id, row["blob_key"], jobs)


def refuse_bundled(row: Mapping[str, Any]) -> None:
    """Raise ``Conflict`` (``bundled-read-only``) for a sample that comes with the program."""
    if row["bundled"]:
        raise Conflict("bundled-read-only", "This sample comes with the program and cannot be changed or deleted.")


async def _discard(parts: Parts, recording_id: str, blob_key: str, jobs: Sequence[str] = ()) -> None:
    """Remove the files of a recording and of jobs that have no row, and its blob unless another recording uses it."""
    async with parts.engine.begin() as connection:
        if not await may_remove(connection):
            return
        for prefix in (*(f"results/{job_id}" for job_id in jobs), own_prefix(recording_id)):
            await parts.blobs.delete_prefix(prefix)
        await delete_if_unused(connection, parts.blobs, blob_key)


def _tracks_key(recording_id: str) -> str:
    return f"{own_prefix(recording_id)}/tracks-{uuid.uuid4().hex[:8]}.parquet"


def spool_folder(parts: Parts) -> Path:
    """A new private folder for one upload; its maker removes it."""
    folder = parts.spool / uuid.uuid4().hex
    folder.mkdir(mode=0o700)
    return folder
