"""The job kind ``read-batch``: a bulk upload that takes too long for a synchronous response.

The files of a bulk upload are stored below ``batches/<batch_id>`` until its job has ended: ``TASK_FILE``, which is a
``ParseBatchTask``, and the files listed in it. File names of users are stored there and not in the job's row.
"""

import asyncio
import uuid
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from sqlalchemy import insert, update
from sqlalchemy.ext.asyncio import AsyncConnection

from stridelab.schemas.population import ReadBatchInput, ReadBatchSummary
from stridelab.service.filenames import child_output_file
from stridelab.service.kinds.base import Blobs, JobKind, Json
from stridelab.service.kinds.read_batch.parsed_upload import ParsedUpload
from stridelab.service.storage.content_addressed import lock_blob
from stridelab.service.storage.tables import recording
from stridelab.service.uploaded_row import file_sha256, new_tracks_key, uploaded_row

READ_BATCH_KIND: Final = "read-batch"
BATCH_FOLDER: Final = "batches"
TASK_FILE: Final = "task.json"


def batch_prefix(job_input: Mapping[str, Any]) -> str:
    """Key prefix of the files of a job with this input."""
    return f"{BATCH_FOLDER}/{job_input['batch_id']}"


async def stage(connection: AsyncConnection, blobs: Blobs, request: ReadBatchInput, folder: Path) -> Json:
    """Fetch the files of the upload; the task is stored with them."""
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
