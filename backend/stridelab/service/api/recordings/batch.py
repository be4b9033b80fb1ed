"""``POST /recordings/batch``: upload of many files, or zips of them, with one subject table.

Reverse proxies abort requests that take minutes. Therefore only a small upload is parsed within the request, for at
most ``batch_answer_s``; a larger or slower one is stored unparsed and read by the job ``read-batch``.
"""

import asyncio
import uuid
from pathlib import Path
from typing import Any, Final

import structlog
from sqlalchemy import update
from starlette.requests import Request

from stridelab.errors import Fault, InvalidInput, StridelabError, UnreadableFile
from stridelab.schemas.marker_sets import SourceMarkerSet
from stridelab.schemas.population import MAX_RECORDINGS, RecordingBatch
from stridelab.schemas.tasks import BatchFile, ParseBatchTask
from stridelab.service.api.dependencies import Parts
from stridelab.service.api.quotas import refuse_full
from stridelab.service.api.recordings.multipart import Limits, ReceivedForm, ReceivedForms, receive_forms
from stridelab.service.api.recordings.parse import Parsed
from stridelab.service.api.recordings.repository import recording_of, recording_row
from stridelab.service.api.recordings.service import delete_recording, store_upload
from stridelab.service.auth.callers import Caller
from stridelab.service.filenames import child_output_file
from stridelab.service.jobs.store import JobRecord
from stridelab.service.kinds.read_batch import kind as read_batch
from stridelab.service.kinds.read_batch.parsed_upload import ParsedUpload
from stridelab.service.kinds.registry import PARSE_BATCH
from stridelab.service.storage.tables import recording
from stridelab.service.stored_marker_sets import source_marker_sets
from stridelab.service.uploaded_row import file_sha256

log = structlog.get_logger(__name__)

TABLE_FIELD, TABLE_FILE, TABLE_BYTES = "subjects", "subjects.csv", 1_000_000
MAX_DIRECT_BYTES: Final = 20_000_000
MAX_DIRECT_FILES: Final = 20
"""Maximum size and number of files of an upload that is parsed within the request."""
JOB_TIMEOUT_FACTOR: Final = 6.0
"""Factor on the time limit per file in a job, which runs at low priority."""


async def receive_batch(parts: Parts, request: Request, folder: Path, caller: Caller) -> RecordingBatch | JobRecord:
    """Receive the form into ``folder``, then store the readable files and list the others, or submit a job.

    Raises the errors of ``receive_forms``, ``UnreadableFile`` (``zip-...``; ``nothing-readable`` if no file is a
    recording), ``InvalidInput`` (``subject-table-invalid``, ``subject-table-twice``, ``too-many-files``,
    ``invalid-request``), ``TooLarge`` (``storage-limit``), ``Busy`` (``queue-full``). Nothing is stored then.
    """
    settings = parts.settings
    total_bytes = settings.max_batch_mb * 1_000_000
    limits = Limits(
        file_bytes=total_bytes,
        free_disk_bytes=settings.min_free_disk_mb * 1_000_000,
        files=MAX_RECORDINGS,
        total_bytes=total_bytes,
        long_fields={TABLE_FIELD: TABLE_BYTES},
    )
    forms = await receive_forms(request, folder, limits)
    unknown = [name[:60] for name in forms.fields if name != TABLE_FIELD]
    if unknown:
        faults = [Fault(name, "unknown field") for name in unknown]
        raise InvalidInput("invalid-request", f"The form is not valid: see {', '.join(unknown)}.", faults)
    async with parts.engine.connect() as connection:
        own_sets = await source_marker_sets(connection, caller.name)
    task = _batch_task(parts, forms, folder, own_sets)
    received_bytes = sum(one.size_bytes for one in forms.files)
    if received_bytes <= MAX_DIRECT_BYTES and len(forms.files) <= MAX_DIRECT_FILES:
        read = await _read_at_once(parts, task, folder)
        if read is not None:
            return await _store_all(parts, ParsedUpload.from_parse_result(read), folder, caller)
    await refuse_full(parts, caller.name, received_bytes)
    return await _submit_job(parts, task, folder, caller)


def _batch_task(parts: Parts, forms: ReceivedForms, folder: Path, own_sets: list[SourceMarkerSet]) -> ParseBatchTask:
    table = forms.fields.get(TABLE_FIELD, "")
    if table.strip():
        (folder / TABLE_FILE).write_text(table, encoding="utf-8")
    settings = parts.settings
    return ParseBatchTask(
        files=[BatchFile(file=one.path.name, filename=one.filename) for one in forms.files],
        marker_sets=own_sets,
        table=TABLE_FILE if table.strip() else None,
        file_bytes=settings.max_upload_mb * 1_000_000,
        total_bytes=settings.max_batch_mb * 1_000_000,
        timeout_s=settings.parse_timeout_s,
        memory_mb=settings.parse_memory_mb,
    )


async def _read_at_once(parts: Parts, task: ParseBatchTask, folder: Path) -> dict[str, Any] | None:
    """Run ``parse_batch`` and return its result; None if it takes longer than ``batch_answer_s``."""
    within_s = parts.settings.batch_answer_s
    if within_s <= 0:
        return None
    try:
        async with asyncio.timeout(within_s), parts.batches:
            outcome = await parts.pool.run(
                PARSE_BATCH,
                task.model_dump(mode="json"),
                folder,
                timeout_s=within_s,
                memory_mb=3 * parts.settings.parse_memory_mb,
                low_priority=False,
            )
    except TimeoutError:
        return None
    if outcome.error_class is not None:
        raise outcome.as_error()
    if outcome.state == "timeout":
        return None
    if outcome.state != "ok":
        message = "Reading the files took more memory than this service allows; send fewer files per upload."
        raise UnreadableFile("batch-not-read", message, [Fault("file", outcome.state)])
    broken = [one["name"] for one in outcome.value["files"] if one.get("problem", {}).get("code") == "parser-crashed"]
    if broken:
        log.warning("files of a batch not read", count=len(broken), log_tail=outcome.log_tail[-2000:])
    return dict(outcome.value)


async def _store_all(parts: Parts, upload: ParsedUpload, folder: Path, caller: Caller) -> RecordingBatch:
    """Store the parsed recordings and link static trials; delete the stored ones again if something fails."""
    ids: dict[int, str] = {}
    try:
        for one in upload.files:
            form = await asyncio.to_thread(_single_form, child_output_file(folder, one.file), one.filename)
            parsed = Parsed(one.facts, child_output_file(folder, one.tracks))
            ids[one.index] = (await store_upload(parts, form, parsed, one.stated_subject, caller.name)).id
        async with parts.engine.begin() as connection:
            for recording_id, static_id in upload.static_trial_ids(ids).items():
                linked = update(recording).where(recording.c.id == recording_id)
                await connection.execute(linked.values(static_recording_id=static_id))
            stored = [recording_of(await recording_row(connection, recording_id)) for recording_id in ids.values()]
    except BaseException:
        for recording_id in ids.values():
            await delete_recording(parts, recording_id, caller)
        raise
    summary = upload.batch_summary(ids)
    return RecordingBatch(
        recordings=stored, studied=summary.studied, subjects=summary.subjects, refused=summary.refused
    )


async def _submit_job(parts: Parts, task: ParseBatchTask, folder: Path, caller: Caller) -> JobRecord:
    """Store the received files and submit the job that reads them."""
    patient = task.model_copy(update={"timeout_s": JOB_TIMEOUT_FACTOR * task.timeout_s})
    (folder / read_batch.TASK_FILE).write_text(patient.model_dump_json(), encoding="utf-8")
    names = [read_batch.TASK_FILE, *(one.file for one in task.files), *([task.table] if task.table else [])]
    request = {"batch_id": uuid.uuid4().hex, "files": names}
    prefix = read_batch.batch_prefix(request)
    try:
        for name in names:
            await parts.blobs.put_file(f"{prefix}/{name}", folder / name)
        submitted = await parts.store.submit(read_batch.READ_BATCH_KIND, request, owner=caller.name)
    except StridelabError:  # the job is certainly not stored; after other errors the janitor removes the files
        await parts.blobs.delete_prefix(prefix)
        raise
    return await parts.store.get(submitted.job_id)


def _single_form(path: Path, filename: str) -> ReceivedForm:
    """One file as the form of a single upload. The hash is computed here, because the child is not trusted."""
    return ReceivedForm(path, filename, path.stat().st_size, file_sha256(path), fields={})
