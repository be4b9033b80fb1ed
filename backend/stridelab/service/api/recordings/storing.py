"""A recording's row and its files belong together: no row without files, no files that nobody needs."""

import asyncio
import time
import uuid
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import structlog
from sqlalchemy import delete, insert, select, update

from stridelab.errors import Conflict, NotFound, Unavailable
from stridelab.schemas.jobs import FINAL_STATES
from stridelab.schemas.recordings import Recording, SubjectFields
from stridelab.service.access import audit
from stridelab.service.access.callers import Caller, require_owner
from stridelab.service.api.parts import Parts
from stridelab.service.api.quotas import refuse_full
from stridelab.service.api.recordings.multipart import ReceivedForm
from stridelab.service.api.recordings.parsing import Parsed, Switches
from stridelab.service.api.recordings.rows import recording_of, recording_row, recordings_with_subjects
from stridelab.service.storage.publication import NO_ANSWER, publishing
from stridelab.service.storage.removal import may_remove
from stridelab.service.storage.tables import job, recording
from stridelab.service.storage.uploads import delete_if_unused, lock_blob, try_lock_blob, upload_key
from stridelab.service.uploaded_row import new_tracks_key, own_prefix, uploaded_row

_LOOK_AGAIN_S: Final = 10.0
"""How long an upload waits for a database that went away while it committed."""
log = structlog.get_logger(__name__)


async def store_upload(
    parts: Parts,
    form: ReceivedForm,
    parsed: Parsed,
    subject: SubjectFields,
    owner: str | None,
    session_id: str | None = None,
) -> Recording:
    """Store a parsed upload: both files, then the row, or nothing; without a stated ``session_id`` it is found.

    The file of an earlier upload of the same bytes is used, after its content has been checked; a damaged one is
    replaced. Raises ``TooLarge`` (``storage-limit``) where ``owner`` has no room left for it, ``Unavailable``
    (``outcome-unknown``) where the database went away while it committed and has not come back.
    """
    await refuse_full(parts, owner, form.size_bytes)
    recording_id = uuid.uuid4().hex
    tracks_key = await new_tracks_key(recording_id, parsed.tracks)
    values = uploaded_row(
        recording_id=recording_id,
        owner=owner,
        filename=form.filename,
        sha256=form.sha256,
        size_bytes=form.size_bytes,
        tracks_key=tracks_key,
        facts=parsed.facts,
        subject=subject,
        session_id=session_id,
    )
    stored: Recording | None = None
    async with publishing(lambda: _discard(parts, recording_id, values["blob_key"])) as publication:
        try:
            async with publication.transaction(parts.engine) as connection:
                for key in (values["blob_key"], tracks_key):
                    await lock_blob(connection, key)
                await parts.blobs.put_file(tracks_key, parsed.tracks)
                await parts.blobs.keep_or_replace(values["blob_key"], form.path, form.sha256)
                await connection.execute(insert(recording).values(values))
                written = recording_of(await recording_row(connection, recording_id))
            stored = written
        except NO_ANSWER:
            if not publication.in_doubt:
                raise
            stored = await _look_again(parts, recording_id, tracks_key)
        publication.settle(published=stored is not None)
    if stored is None:
        raise Unavailable("database-unreachable", "The database does not answer; nothing was stored. Try again.")
    return stored


async def uploaded_before(parts: Parts, form: ReceivedForm, owner: str | None) -> Recording | None:
    """The newest recording that ``owner`` made of the same bytes, or None; samples of the program do not count.

    Its stored file is checked, and replaced by the one of ``form`` where it is damaged.
    """
    key = upload_key(form.sha256)
    same = recordings_with_subjects().where(
        recording.c.sha256 == form.sha256,
        recording.c.blob_key == key,
        recording.c.owner.is_not_distinct_from(owner),
        ~recording.c.bundled,
    )
    newest = same.order_by(recording.c.created_at.desc(), recording.c.id.desc()).limit(1)
    async with parts.engine.begin() as connection:
        await lock_blob(connection, key)
        row = (await connection.execute(newest)).mappings().one_or_none()
        if row is None:
            return None
        await parts.blobs.keep_or_replace(key, form.path, form.sha256)
        return recording_of(row)


async def _look_again(parts: Parts, recording_id: str, tracks_key: str) -> Recording | None:
    """A recording whose COMMIT nobody answered, or None where it was rolled back.

    The lock on ``tracks_key`` is held by the transaction in question until it has ended, on whichever side of a
    broken connection. Raises ``Unavailable`` (``outcome-unknown``) where that takes longer than ``_LOOK_AGAIN_S``.
    """
    deadline = time.monotonic() + _LOOK_AGAIN_S
    while True:
        try:
            async with parts.engine.begin() as connection:
                if await try_lock_blob(connection, tracks_key):
                    return recording_of(await recording_row(connection, recording_id))
        except NotFound:
            return None
        except NO_ANSWER as error:
            log.warning("commit-in-doubt", recording=recording_id, error=type(error).__name__)
        if time.monotonic() > deadline:
            raise Unavailable(
                "outcome-unknown",
                "The database did not say whether the recording was stored. Look into the list of recordings "
                "before you send it again.",
            )
        await asyncio.sleep(0.2)


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
    tracks_key = await new_tracks_key(before["id"], parsed.tracks)
    async with publishing(lambda: _discard_tracks(parts, tracks_key)) as publication:
        async with publication.transaction(parts.engine) as connection:
            await lock_blob(connection, tracks_key)
            await parts.blobs.put_file(tracks_key, parsed.tracks)
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
        publication.settle(published=True)
    await _discard_tracks(parts, before["tracks_key"])


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


async def _discard_tracks(parts: Parts, tracks_key: str) -> None:
    """Remove tracks that no row names, unless a backup is made; the janitor removes them then."""
    async with parts.engine.begin() as connection:
        if await may_remove(connection):
            await parts.blobs.delete(tracks_key)


def spool_folder(parts: Parts) -> Path:
    """A new private folder for one upload; its maker removes it."""
    folder = parts.spool / uuid.uuid4().hex
    folder.mkdir(mode=0o700)
    return folder
