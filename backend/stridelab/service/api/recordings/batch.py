"""``POST /recordings/batch``: many files, or zips of them, with one subject table."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import structlog
from sqlalchemy import update
from starlette.requests import Request

from stridelab.errors import Fault, InvalidInput, UnreadableFile
from stridelab.schemas.population import (
    MAX_RECORDINGS,
    PersonFields,
    RecordingBatch,
    RefusedFile,
    SubjectOfRecording,
)
from stridelab.schemas.recordings import RecordingFacts, SubjectFields
from stridelab.service.access.callers import Caller
from stridelab.service.api.parts import Parts
from stridelab.service.api.recordings.multipart import Limits, ReceivedForm, ReceivedForms, receive_forms, safe_filename
from stridelab.service.api.recordings.parsing import Parsed
from stridelab.service.api.recordings.rows import recording_of, recording_row
from stridelab.service.api.recordings.storing import delete_recording, store_upload
from stridelab.service.jobs.kinds.registry import PARSE_BATCH
from stridelab.service.storage.tables import recording

log = structlog.get_logger(__name__)

TABLE_FIELD, TABLE_FILE, TABLE_BYTES = "subjects", "subjects.csv", 1_000_000
TIMEOUT_S = 900.0


@dataclass(frozen=True)
class _Line:
    """A line of the table: whose recording it is, and which file is the static trial."""

    static: int | None
    person: PersonFields


async def receive_batch(parts: Parts, request: Request, folder: Path, caller: Caller) -> RecordingBatch:
    """Read the form of ``request`` into ``folder``, store what can be read, and say what cannot.

    Raises as ``receive_forms`` does, ``UnreadableFile`` (``zip-...``; ``nothing-readable`` where no file is a
    recording), ``InvalidInput`` (``subject-table-invalid``, ``subject-table-twice``, ``too-many-files``,
    ``invalid-request``). Nothing is kept then.
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
    return await _store_all(parts, await _read_all(parts, forms, folder), folder, caller)


async def _read_all(parts: Parts, forms: ReceivedForms, folder: Path) -> dict[str, Any]:
    table = forms.fields.get(TABLE_FIELD, "")
    if table.strip():
        (folder / TABLE_FILE).write_text(table, encoding="utf-8")
    settings = parts.settings
    task = {
        "files": [{"file": one.path.name, "filename": one.filename} for one in forms.files],
        "table": TABLE_FILE if table.strip() else None,
        "file_bytes": settings.max_upload_mb * 1_000_000,
        "total_bytes": settings.max_batch_mb * 1_000_000,
        "timeout_s": settings.parse_timeout_s,
        "memory_mb": settings.parse_memory_mb,
    }
    async with parts.batches:
        outcome = await parts.pool.run(
            PARSE_BATCH, task, folder, timeout_s=TIMEOUT_S, memory_mb=3 * settings.parse_memory_mb, yields=False
        )
    if outcome.raised is not None:
        raise outcome.as_error()
    if outcome.state != "ok":
        message = "Reading the files took more time or memory than this service allows; send fewer at a time."
        raise UnreadableFile("batch-not-read", message, [Fault("file", outcome.state)])
    broken = [one["name"] for one in outcome.value["files"] if one.get("problem", {}).get("code") == "parser-crashed"]
    if broken:
        log.warning("files of a batch not read", count=len(broken), log_tail=outcome.log_tail[-2000:])
    return dict(outcome.value)


async def _store_all(parts: Parts, read: dict[str, Any], folder: Path, caller: Caller) -> RecordingBatch:
    """Store what was read and link static trials; what was stored goes again where something fails."""
    lines = {row["place"]: _Line(row["static"], PersonFields.model_validate(row["person"])) for row in read["rows"]}
    refused = [
        RefusedFile(filename=safe_filename(one["name"]), **one["problem"]) for one in read["files"] if "problem" in one
    ]
    readable = {place: one for place, one in enumerate(read["files"]) if "problem" not in one}
    if not readable:
        faults = [Fault(one.filename, f"{one.message} ({one.code})") for one in refused]
        raise UnreadableFile("nothing-readable", "None of the files is a recording that can be read.", faults)
    ids: dict[int, str] = {}
    try:
        for place, one in readable.items():
            form = ReceivedForm(
                folder / one["file"], safe_filename(one["name"]), one["bytes"], one["sha256"], fields={}
            )
            parsed = Parsed(RecordingFacts.model_validate(one["facts"]), folder / one["tracks"])
            person = lines[place].person if place in lines else PersonFields()
            ids[place] = (await store_upload(parts, form, parsed, _stated(person), caller.name)).id
        async with parts.engine.begin() as connection:
            for place, line in lines.items():
                if place in ids and line.static in ids:
                    linked = update(recording).where(recording.c.id == ids[place])
                    await connection.execute(linked.values(static_recording_id=ids[line.static]))
            stored = [recording_of(await recording_row(connection, recording_id)) for recording_id in ids.values()]
    except BaseException:
        for recording_id in ids.values():
            await delete_recording(parts, recording_id, caller)
        raise
    subjects = [
        SubjectOfRecording(recording_id=ids[place], **line.person.model_dump())
        for place, line in lines.items()
        if place in ids
    ]
    standing = {line.static for line in lines.values()} - set(lines)
    studied = [recording_id for place, recording_id in ids.items() if place not in standing]
    return RecordingBatch(recordings=stored, studied=studied, subjects=subjects, refused=refused)


def _stated(person: PersonFields) -> SubjectFields:
    return SubjectFields(name=person.subject, **person.model_dump(exclude={"subject", "group"}))
