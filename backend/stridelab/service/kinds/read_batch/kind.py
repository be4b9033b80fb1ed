"""The job kind ``read-batch``: a bulk upload that takes too long for a synchronous response.

The files of a bulk upload are stored below ``batches/<batch_id>`` until its job has ended: ``TASK_FILE``, which is a
``ParseBatchTask``, and the files listed in it. File names of users are stored there and not in the job's row.
"""

import asyncio
import uuid
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from sqlalchemy import insert, update
from sqlalchemy.ext.asyncio import AsyncConnection

from stridelab.errors import Fault, UnreadableFile
from stridelab.schemas.base import Contract
from stridelab.schemas.population import (
    PersonFields,
    ReadBatchInput,
    ReadBatchSummary,
    RefusedFile,
    SubjectOfRecording,
)
from stridelab.schemas.recordings import RecordingFacts, SubjectFields
from stridelab.service.filenames import child_output_file, safe_filename
from stridelab.service.kinds.base import Blobs, JobKind, Json
from stridelab.service.storage.content_addressed import lock_blob
from stridelab.service.storage.tables import recording
from stridelab.service.uploaded_row import file_sha256, new_tracks_key, uploaded_row

READ_BATCH_KIND: Final = "read-batch"
BATCH_FOLDER: Final = "batches"
TASK_FILE: Final = "task.json"


def batch_prefix(job_input: Mapping[str, Any]) -> str:
    """Key prefix of the files of a job with this input."""
    return f"{BATCH_FOLDER}/{job_input['batch_id']}"


@dataclass(frozen=True)
class ParsedFile:
    """A readable recording of the upload: its index among the files, its facts, and its subject."""

    index: int
    file: str
    filename: str
    tracks: str
    facts: RecordingFacts
    person: PersonFields

    @property
    def stated_subject(self) -> SubjectFields:
        """The subject's fields in the subject table."""
        return SubjectFields(name=self.person.subject, **self.person.model_dump(exclude={"subject", "group"}))


@dataclass(frozen=True)
class ParsedUpload:
    """A parsed bulk upload; ``people`` and ``statics`` map a file's index to its subject and static trial's index."""

    files: tuple[ParsedFile, ...]
    refused_files: tuple[RefusedFile, ...]
    people: Mapping[int, PersonFields]
    statics: Mapping[int, int | None]

    @staticmethod
    def from_parse_result(parse_result: Mapping[str, Any]) -> "ParsedUpload":
        """From the result of ``run.parse_batch``. Raises ``UnreadableFile`` (``nothing-readable``)."""
        people = {row["place"]: PersonFields.model_validate(row["person"]) for row in parse_result["rows"]}
        files, refused = [], []
        for place, one in enumerate(parse_result["files"]):
            name = safe_filename(one["name"])
            if "problem" in one:
                refused.append(RefusedFile(filename=name, **one["problem"]))
                continue
            facts = RecordingFacts.model_validate(one["facts"])
            person = people.get(place, PersonFields())
            files.append(ParsedFile(place, one["file"], name, one["tracks"], facts, person))
        if not files:
            faults = [Fault(one.filename, f"{one.message} ({one.code})") for one in refused]
            raise UnreadableFile("nothing-readable", "None of the files is a readable recording.", faults)
        return ParsedUpload(
            tuple(files), tuple(refused), people, {row["place"]: row["static"] for row in parse_result["rows"]}
        )

    def static_trial_ids(self, ids: Mapping[int, str]) -> dict[str, str]:
        """Ids of static trials by recording id, for those among ``ids`` (by index)."""
        return {
            ids[place]: ids[static]
            for place, static in self.statics.items()
            if static is not None and place in ids and static in ids
        }

    def batch_summary(self, ids: Mapping[int, str]) -> ReadBatchSummary:
        """Summary of the upload for the user, with recording ``ids`` (by index)."""
        standing = set(self.statics.values()) - set(self.statics)
        subjects = [
            SubjectOfRecording(recording_id=ids[place], **person.model_dump())
            for place, person in self.people.items()
            if place in ids
        ]
        studied = [recording_id for place, recording_id in ids.items() if place not in standing]
        return ReadBatchSummary(
            recording_ids=list(ids.values()), studied=studied, subjects=subjects, refused=list(self.refused_files)
        )


async def stage(connection: AsyncConnection, blobs: Blobs, input: Contract, folder: Path) -> Json:  # noqa: A002
    """Fetch the files of the upload; the task is stored with them."""
    request = ReadBatchInput.model_validate(input.model_dump())
    for name in request.files:
        await blobs.get_file(f"{batch_prefix(request.model_dump())}/{name}", folder / name)
    return {"task": (folder / TASK_FILE).read_text(encoding="utf-8")}


async def publish(
    connection: AsyncConnection, blobs: Blobs, job_row: Mapping[str, Any], outcome: Json, folder: Path
) -> Json:
    """Insert the recordings of a parsed bulk upload; returns the summary with their ids.

    Ids are derived from the job's id, as in ``simulate-recording``.
    """
    upload = ParsedUpload.from_parse_result(outcome["read"])
    ids = {
        one.index: uuid.uuid5(uuid.NAMESPACE_URL, f"stridelab:job:{job_row['id']}:{one.index}").hex
        for one in upload.files
    }
    rows = {}
    for one in upload.files:
        file = child_output_file(folder, one.file)
        rows[one.index] = uploaded_row(
            recording_id=ids[one.index],
            owner=job_row["owner"],
            filename=one.filename,
            sha256=await asyncio.to_thread(file_sha256, file),
            size_bytes=file.stat().st_size,
            tracks_key=await new_tracks_key(ids[one.index], child_output_file(folder, one.tracks)),
            facts=one.facts,
            subject=one.stated_subject,
        )
    # the same order in all transactions, so that two uploads of the same files do not deadlock
    for key in sorted({key for row in rows.values() for key in (row["blob_key"], row["tracks_key"])}):
        await lock_blob(connection, key)
    for one in upload.files:
        await blobs.put_file(rows[one.index]["tracks_key"], folder / one.tracks)
        await blobs.keep_or_replace(rows[one.index]["blob_key"], folder / one.file, rows[one.index]["sha256"])
        await connection.execute(insert(recording).values(rows[one.index]))
    for recording_id, static_id in upload.static_trial_ids(ids).items():
        linked = update(recording).where(recording.c.id == recording_id)
        await connection.execute(linked.values(static_recording_id=static_id))
    return upload.batch_summary(ids).model_dump(mode="json")


KIND = JobKind(
    name=READ_BATCH_KIND,
    title="Bulk upload",
    description="Reads the files of a bulk upload.",
    input_model=ReadBatchInput,
    summary_model=ReadBatchSummary,
    stage=stage,
    publish=publish,
    timeout_s=7200.0,
    memory_mb=4096,
    lane="long",
    offered=False,
    own_files=batch_prefix,
)
