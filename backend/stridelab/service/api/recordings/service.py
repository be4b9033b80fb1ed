"""Stores, changes and deletes recordings; keeps the rows of the database and the files of the store consistent."""

import asyncio
import tempfile
import time
import uuid
from collections.abc import AsyncIterator, Callable, Collection, Mapping, Sequence
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any, Final

import structlog
from sqlalchemy import delete, insert, select, update

from stridelab.errors import Busy, Conflict, Fault, InvalidInput, NotFound, TooLarge, Unavailable
from stridelab.schemas.jobs import FINAL_STATES
from stridelab.schemas.marker_sets import MarkerSetProposal
from stridelab.schemas.recordings import PlateSwitch, Recording, RecordingFacts, RecordingPatch, SubjectFields
from stridelab.schemas.streams import Triple
from stridelab.service.api.dependencies import Parts
from stridelab.service.api.quotas import refuse_full
from stridelab.service.api.recordings.multipart import ReceivedForm
from stridelab.service.api.recordings.parse import (
    Parsed,
    Switches,
    parse_recording,
    propose_of_file,
    static_pose_of_file,
)
from stridelab.service.api.recordings.repository import recording_of, recording_row, recordings_with_subjects
from stridelab.service.api.subjects.endpoints import subject_row
from stridelab.service.auth import audit
from stridelab.service.auth.callers import Caller, require_owner
from stridelab.service.kinds.session_staging import session_of
from stridelab.service.recording_sessions import session_id_of
from stridelab.service.storage.content_addressed import delete_if_unused, lock_blob, try_lock_blob, upload_key
from stridelab.service.storage.file_removal import may_remove
from stridelab.service.storage.publication import DATABASE_ERRORS, publish_files
from stridelab.service.storage.tables import job, recording
from stridelab.service.uploaded_row import new_tracks_key, recording_prefix, uploaded_row


async def change_recording(parts: Parts, recording_id: str, patch: RecordingPatch) -> Recording:
    """Change the fields set in ``patch``; a change of switches parses the file again.

    Raises ``NotFound`` (``recording-not-found``), ``Conflict`` (``bundled-read-only``, ``changed-meanwhile``),
    ``InvalidInput`` (``invalid-request``) naming an invalid field, and the errors of parsing.
    """
    async with parts.engine.connect() as connection:
        row = await recording_row(connection, recording_id)
    refuse_bundled(row)
    links = await _changed_links(parts, row, patch)
    static_labels = await _static_labels(parts, {**row, **links})
    switches = _patched_switches(row, patch, static_labels)
    lacks_clock = "session_id" in patch.model_fields_set and "clock" not in row["facts"]
    if switches != Switches.of_row(row) or lacks_clock:
        await _parse_stored(parts, row, switches, static_labels, lambda locked: _changed_columns(locked, patch, links))
    elif patch.model_fields_set:
        async with parts.engine.begin() as connection:
            locked = await recording_row(connection, recording_id, lock=True)
            changes = _changed_columns(locked, patch, links)
            if changes:
                await connection.execute(update(recording).where(recording.c.id == recording_id).values(changes))
    async with parts.engine.connect() as connection:
        return recording_of(await recording_row(connection, recording_id))


async def parse_again(parts: Parts, recording_id: str) -> None:
    """Parse the file of a recording again with its present switches and the present marker sets.

    Raises ``NotFound`` (``recording-not-found``), ``Conflict`` (``changed-meanwhile``), and the errors of parsing.
    """
    async with parts.engine.connect() as connection:
        row = await recording_row(connection, recording_id)
    await _parse_stored(parts, row, Switches.of_row(row), await _static_labels(parts, row), lambda _: {})


async def propose_landmarks(parts: Parts, recording_id: str) -> MarkerSetProposal:
    """Propose the landmarks of the markers of a recording.

    Raises ``NotFound`` (``recording-not-found``) and the errors of parsing.
    """
    async with parts.engine.connect() as connection:
        row = await recording_row(connection, recording_id)
    async with _stored_file(parts, row) as folder:
        proposal = await propose_of_file(parts, folder, "trial", row["filename"])
    return proposal.model_copy(update={"recording_id": recording_id})


async def static_pose(parts: Parts, recording_id: str) -> dict[str, Triple]:
    """Median position of each marker of a stored recording, in metres with z up. Raises as ``propose_landmarks``."""
    async with parts.engine.connect() as connection:
        row = await recording_row(connection, recording_id)
    async with _stored_file(parts, row) as folder:
        return await static_pose_of_file(parts, folder, "trial", row["filename"])


@asynccontextmanager
async def _stored_file(parts: Parts, row: Mapping[str, Any]) -> AsyncIterator[Path]:
    """A temporary folder with the stored file of a recording as ``trial``."""
    with tempfile.TemporaryDirectory(dir=parts.spool) as name:
        await parts.blobs.get_file(row["blob_key"], Path(name) / "trial", row["sha256"])
        yield Path(name)


async def _parse_stored(
    parts: Parts,
    row: Mapping[str, Any],
    switches: Switches,
    static_labels: Sequence[str],
    changes: Callable[[Mapping[str, Any]], Mapping[str, Any]],
) -> None:
    """Parse the stored file of a recording and replace its facts; ``changes`` as in ``replace_facts``."""
    async with _stored_file(parts, row) as folder:
        parsed = await parse_recording(
            parts, folder, "trial", row["filename"], switches, static_labels, owner=row["owner"]
        )
        await replace_facts(parts, row, switches, parsed, changes)


def _subject_fields(row: Mapping[str, Any], patch: RecordingPatch) -> dict[str, Any]:
    """Changed column of stated subject fields: given fields are set, null clears one field or all."""
    if "subject" not in patch.model_fields_set:
        return {}
    if patch.subject is None:
        return {"subject_fields": {}}
    merged = {**row["subject_fields"], **patch.subject.model_dump(mode="json", exclude_unset=True)}
    return {"subject_fields": {name: value for name, value in merged.items() if value is not None}}


async def _changed_links(parts: Parts, row: Mapping[str, Any], patch: RecordingPatch) -> dict[str, Any]:
    """Changed columns for the links to a subject and to a static trial, which must exist."""
    changes: dict[str, Any] = {}
    async with parts.engine.connect() as connection:
        try:
            if "subject_id" in patch.model_fields_set:
                changes["subject_id"] = patch.subject_id
                if patch.subject_id is not None:
                    await subject_row(connection, patch.subject_id)
            if "static_recording_id" in patch.model_fields_set:
                changes["static_recording_id"] = patch.static_recording_id
                if patch.static_recording_id == row["id"]:
                    raise _invalid_change("static_recording_id", "a recording cannot be its own static trial")
                if patch.static_recording_id is not None:
                    await recording_row(connection, patch.static_recording_id)
        except NotFound as error:
            where = "static_recording_id" if error.code == "recording-not-found" else "subject_id"
            raise _invalid_change(where, error.message) from error
    return changes


def _changed_columns(row: Mapping[str, Any], patch: RecordingPatch, links: Mapping[str, Any]) -> dict[str, Any]:
    """Changed columns; a session that is not stated is determined again from the subject."""
    changes = {**links, **_subject_fields(row, patch)}
    if "session_id" in patch.model_fields_set and patch.session_id is not None:
        return {**changes, "session_id": patch.session_id, "session_stated": True}
    if not patch.model_fields_set or (row["session_stated"] and "session_id" not in patch.model_fields_set):
        return changes
    return {**changes, "session_id": session_id_of({**row, **changes}, row["created_at"]), "session_stated": False}


async def _static_labels(parts: Parts, row: Mapping[str, Any]) -> tuple[str, ...]:
    """Labels of the recording's static trial, to which its marker map may also refer."""
    async with parts.engine.connect() as connection:
        static = (await session_of(connection, row)).static
    return () if static is None else tuple(RecordingFacts.model_validate(static["facts"]).labels)


def _patched_switches(row: Mapping[str, Any], patch: RecordingPatch, static_labels: Collection[str]) -> Switches:
    """Switches after ``patch``: the marker map is replaced, plates are changed individually; null resets.

    The marker map may also refer to labels of the static trial.
    """
    present = Switches.of_row(row)
    facts = RecordingFacts.model_validate(row["facts"])
    marker_map, plates = dict(present.marker_map), dict(present.plates)
    if "marker_map" in patch.model_fields_set:
        marker_map = dict(patch.marker_map or {})
        unknown = [label for label in marker_map.values() if label not in {*facts.labels, *static_labels}]
        if unknown:
            raise _invalid_change(
                "marker_map",
                f"neither the file nor its static trial has a marker {', '.join(label[:40] for label in unknown[:5])}",
            )
    if "plates" in patch.model_fields_set:
        known = {plate.index for plate in facts.plates}
        if patch.plates is None:
            plates = {}
        for index, switch in (patch.plates or {}).items():
            if index not in known:
                raise _invalid_change(f"plates.{index}", f"the file has the plates {sorted(known)}")
            before = plates.get(index, PlateSwitch()).model_dump(exclude_none=True)
            plates[index] = PlateSwitch.model_validate({**before, **switch.model_dump(exclude_unset=True)})
    return Switches(marker_map, plates)


def _invalid_change(where: str, message: str) -> InvalidInput:
    return InvalidInput("invalid-request", f"The change is not possible: {where}: {message}.", [Fault(where, message)])


_COMMIT_WAIT_S: Final = 10.0
"""Maximum time to wait for the database if its connection is lost during a commit."""
log = structlog.get_logger(__name__)


async def store_upload(
    parts: Parts,
    form: ReceivedForm,
    parsed: Parsed,
    subject: SubjectFields,
    owner: str | None,
    session_id: str | None = None,
) -> Recording:
    """Store a parsed upload atomically: both files, then the row. ``session_id`` None determines the session.

    The stored file of an earlier upload of the same bytes is reused after a check of its content; a damaged one is
    replaced. Raises ``TooLarge`` (``storage-limit``) if the quota of ``owner`` is exhausted, ``Unavailable``
    (``outcome-unknown``) if the connection is lost during the commit and the database does not come back.
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
    async with publish_files(lambda: _discard_files(parts, recording_id, values["blob_key"])) as publication:
        try:
            async with publication.transaction(parts.engine) as connection:
                for key in (values["blob_key"], tracks_key):
                    await lock_blob(connection, key)
                await parts.blobs.put_file(tracks_key, parsed.tracks)
                await parts.blobs.keep_or_replace(values["blob_key"], form.path, form.sha256)
                await connection.execute(insert(recording).values(values))
                written = recording_of(await recording_row(connection, recording_id))
            stored = written
        except DATABASE_ERRORS:
            if not publication.in_doubt:
                raise
            stored = await _read_after_lost_commit(parts, recording_id, tracks_key)
        publication.record_outcome(published=stored is not None)
    if stored is None:
        raise Unavailable("database-unreachable", "The database does not answer; nothing was stored. Try again.")
    return stored


async def start_estimate(parts: Parts, stored: Recording, owner: str | None) -> str | None:
    """Submit ``estimate-com`` with its default method; returns the job id, None where no method is applicable.

    The upload is stored whether or not the queue has a place, so a full queue is logged only.
    """
    if not any(offer.possible for offer in stored.estimates):
        return None
    try:
        await refuse_full(parts, owner)
        request = {"recording_id": stored.id}
        submitted = await parts.store.submit("estimate-com", request, owner=owner, recording_id=stored.id)
    except (Busy, TooLarge, NotFound) as error:
        structlog.get_logger().warning("estimate_not_started", recording_id=stored.id, code=error.code)
        return None
    return submitted.job_id


async def uploaded_before(parts: Parts, form: ReceivedForm, owner: str | None) -> Recording | None:
    """The newest recording of ``owner`` with the same bytes, except bundled samples; None if there is none.

    Its stored file is checked, and replaced by the one of ``form`` if it is damaged.
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


async def _read_after_lost_commit(parts: Parts, recording_id: str, tracks_key: str) -> Recording | None:
    """Read a recording whose COMMIT was not acknowledged; None if the transaction was rolled back.

    The transaction in question holds the lock on ``tracks_key`` until the database has ended it, even if the
    connection is lost. Raises ``Unavailable`` (``outcome-unknown``) if that takes too long.
    """
    deadline = time.monotonic() + _COMMIT_WAIT_S
    while True:
        try:
            async with parts.engine.begin() as connection:
                if await try_lock_blob(connection, tracks_key):
                    return recording_of(await recording_row(connection, recording_id))
        except NotFound:
            return None
        except DATABASE_ERRORS as error:
            log.warning("commit-in-doubt", recording=recording_id, error=type(error).__name__)
        if time.monotonic() > deadline:
            raise Unavailable(
                "outcome-unknown",
                "The database did not confirm whether the recording was stored. Check the list of recordings "
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
    """Replace facts and tracks by those parsed with new switches; ``changes`` gives further columns for the row.

    Raises ``Conflict`` (``changed-meanwhile``) if the switches were changed since ``before`` was read.
    """
    tracks_key = await new_tracks_key(before["id"], parsed.tracks)
    async with publish_files(lambda: _discard_tracks(parts, tracks_key)) as publication:
        async with publication.transaction(parts.engine) as connection:
            await lock_blob(connection, tracks_key)
            await parts.blobs.put_file(tracks_key, parsed.tracks)
            row = await recording_row(connection, before["id"], lock=True)
            if row["tracks_key"] != before["tracks_key"]:
                raise Conflict(
                    "changed-meanwhile", "The recording was changed by another request in the meantime; try again."
                )
            values = {
                **changes(row),
                **switches.to_columns(),
                "facts": parsed.facts.model_dump(mode="json"),
                "tracks_key": tracks_key,
            }
            await connection.execute(update(recording).where(recording.c.id == before["id"]).values(values))
        publication.record_outcome(published=True)
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
        await audit.record_action(connection, caller, "recording-deleted", recording_id)
    await _discard_files(parts, recording_id, row["blob_key"], jobs)


def refuse_bundled(row: Mapping[str, Any]) -> None:
    """Raise ``Conflict`` (``bundled-read-only``) for a bundled sample."""
    if row["bundled"]:
        raise Conflict("bundled-read-only", "This sample is part of the program and cannot be changed or deleted.")


async def _discard_files(parts: Parts, recording_id: str, blob_key: str, jobs: Sequence[str] = ()) -> None:
    """Remove the files of a deleted recording and its jobs, and its blob unless another recording uses it."""
    async with parts.engine.begin() as connection:
        if not await may_remove(connection):
            return
        for prefix in (*(f"results/{job_id}" for job_id in jobs), recording_prefix(recording_id)):
            await parts.blobs.delete_prefix(prefix)
        await delete_if_unused(connection, parts.blobs, blob_key)


async def _discard_tracks(parts: Parts, tracks_key: str) -> None:
    """Remove tracks without a row; while a backup runs, this is left to the janitor."""
    async with parts.engine.begin() as connection:
        if await may_remove(connection):
            await parts.blobs.delete(tracks_key)


def spool_folder(parts: Parts) -> Path:
    """Create a private folder for one upload; the caller removes it."""
    folder = parts.spool / uuid.uuid4().hex
    folder.mkdir(mode=0o700)
    return folder
