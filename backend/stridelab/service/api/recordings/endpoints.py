"""Recordings: uploaded, looked at, corrected, downloaded, deleted."""

import shutil
from typing import Annotated, Any, Final

from fastapi import APIRouter, Body, Query, Request, Response
from starlette.responses import JSONResponse, StreamingResponse

from stridelab.schemas.base import Page
from stridelab.schemas.jobs import Job
from stridelab.schemas.population import RecordingBatch
from stridelab.schemas.recordings import Recording, RecordingPatch
from stridelab.service.api.dependencies import AppParts, CallerOf
from stridelab.service.api.downloads import OCTETS, PARQUET, send_blob
from stridelab.service.api.jobs import delete
from stridelab.service.api.jobs.presentation import job_of
from stridelab.service.api.openapi import failures
from stridelab.service.api.pagination import Cursor, Limit, cut, newest_first
from stridelab.service.api.recordings import service
from stridelab.service.api.recordings.batch import receive_batch
from stridelab.service.api.recordings.form_fields import session_of_form, subject_of_form
from stridelab.service.api.recordings.multipart import Limits, receive_form
from stridelab.service.api.recordings.parse import NO_SWITCHES, parse
from stridelab.service.api.recordings.repository import recording_of, recording_row, recordings_with_subjects
from stridelab.service.api.strict_json import StrictRoute
from stridelab.service.storage.tables import recording

REUSED: Final = "Stridelab-Reused"
"""Header of an answer to an upload of which nothing was stored, because the bytes were there."""
Reuse = Annotated[
    bool,
    Query(
        description="answer with the newest recording that you made of the same bytes, where there is one, as it is: "
        "nothing is stored, and the other fields of the form are not used"
    ),
]
WithStudies = Annotated[bool, Query(description="also delete finished studies of one's own that hold the person")]

router = APIRouter(prefix="/recordings", tags=["recordings"], route_class=StrictRoute)


def _form(fields: dict[str, Any]) -> dict[str, Any]:
    """How the interface describes a multipart form of ``fields``, of which ``file`` must be there."""
    schema = {"type": "object", "required": ["file"], "additionalProperties": False, "properties": fields}
    return {"requestBody": {"required": True, "content": {"multipart/form-data": {"schema": schema}}}}


_FORM: Final = _form(
    {
        "file": {
            "type": "string",
            "format": "binary",
            "description": "a .c3d file, a .trc file, or a .zip of one .trc and one .mot or .sto",
        },
        "subject_name": {"type": "string", "maxLength": 80, "description": "a pseudonym"},
        "height_m": {"type": "number", "minimum": 0.4, "maximum": 2.6},
        "mass_kg": {"type": "number", "minimum": 2, "maximum": 400},
        "sex": {"type": "string", "enum": ["female", "male"]},
        "age_years": {"type": "number", "minimum": 0, "maximum": 120},
        "session_id": {
            "type": "string",
            "maxLength": 64,
            "pattern": "^[A-Za-z0-9._-]*$",
            "description": "trials of one person and one day; found by itself where it is left out",
        },
    }
)
_BATCH: Final = _form(
    {
        "file": {
            "type": "array",
            "items": {"type": "string", "format": "binary"},
            "description": "recordings as `POST /recordings` takes them, and .zip files of recordings",
        },
        "subjects": {
            "type": "string",
            "description": "CSV: file, subject, group, height_m, mass_kg, sex, age, static",
        },
    }
)
_CHANGES: Final[Any] = {
    "subject": {"summary": "State height and sex", "value": {"subject": {"height_m": 1.71, "sex": "female"}}},
    "plate": {
        "summary": "Leave the second plate out, raise the threshold of the first",
        "value": {"plates": {"2": {"use": False}, "1": {"threshold_n": 30.0}}},
    },
    "reset": {"summary": "Undo all switches", "value": {"plates": None, "marker_map": None}},
}
InSession = Annotated[str | None, Query(max_length=64, pattern=r"^[A-Za-z0-9._-]*$", description="one session alone")]
OfSubject = Annotated[str | None, Query(max_length=64, pattern=r"^[A-Za-z0-9_-]*$", description="one subject alone")]
Linked = Annotated[bool | None, Query(description="true: those that are linked to a subject; false: the others")]
_UNKNOWN: Final = failures(s404="No recording with this id (`recording-not-found`).")
_FILE: Final[dict[int | str, dict[str, Any]]] = {
    200: {"description": "The file.", "content": {OCTETS: {"schema": {"type": "string", "format": "binary"}}}}
}
_TABLE: Final[dict[int | str, dict[str, Any]]] = {
    200: {"description": "The table.", "content": {PARQUET: {"schema": {"type": "string", "format": "binary"}}}}
}


@router.post(
    "",
    status_code=201,
    summary="Upload a recording",
    openapi_extra=_FORM,
    responses=failures(
        s413="The file is over the limit (`upload-too-large`), or over yours (`storage-limit`).",
        s422="The file cannot be read (for example `unreadable-file`, `empty-file`), or a field is not valid.",
        s507="No disk space is left (`disk-full`).",
    ),
)
async def upload_recording(
    parts: AppParts, caller: CallerOf, request: Request, response: Response, reuse: Reuse = False
) -> Recording:
    """Upload a `.c3d` or `.trc` file, or a `.zip` of `.trc` and `.mot`/`.sto`, as the form field `file`.

    A `.trc` alone holds markers and no forces: of the methods of `estimate-com`, `geometry` takes it.

    The file is read before the answer: 201 means that it is stored and understood, and what is in it. A file that
    cannot be read is refused with the reason, and nothing of it is kept. The same bytes sent again are another
    recording, unless `reuse` asks for the one that is there, which is then the answer with the header
    `Stridelab-Reused`.
    """
    limits = Limits(parts.settings.max_upload_mb * 1_000_000, parts.settings.min_free_disk_mb * 1_000_000)
    folder = service.spool_folder(parts)
    try:
        form = await receive_form(request, folder / "trial", limits)
        subject, session_id = subject_of_form(form.fields), session_of_form(form.fields)
        known = await service.uploaded_before(parts, form, caller.name) if reuse else None
        if known is not None:
            response.headers.update({"Location": f"/api/v1/recordings/{known.id}", REUSED: "true"})
            return known
        parsed = await parse(parts, folder, form.path.name, form.filename, NO_SWITCHES)
        stored = await service.store_upload(parts, form, parsed, subject, caller.name, session_id)
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    response.headers["Location"] = f"/api/v1/recordings/{stored.id}"
    return stored


@router.post(
    "/batch",
    status_code=201,
    summary="Upload many recordings",
    openapi_extra=_BATCH,
    response_model=RecordingBatch,
    responses={
        202: {"model": Job, "description": "The files are read by a job, whose summary is a ReadBatchSummary."},
        **failures(
            s413="The files are over the limit (`upload-too-large`), or over yours (`storage-limit`).",
            s422="No file can be read (`nothing-readable`), or a zip or the table cannot be used.",
            s429="Too many jobs are waiting (`queue-full`), or of yours (`user-queue-full`).",
            s507="No disk space is left (`disk-full`).",
        ),
    },
)
async def upload_recordings(parts: AppParts, caller: CallerOf, request: Request) -> RecordingBatch | Response:
    """Upload many recordings, or zips of them, with one subject table.

    What can be read is stored, what cannot be is listed in `refused`; a zip or a table that cannot be used refuses all.
    An upload of more than 20 files or 20 MB, and one that is not read within `STRIDELAB_BATCH_ANSWER_S`, is answered
    202 with the job that reads it (`Location`).
    """
    folder = service.spool_folder(parts)
    try:
        answer = await receive_batch(parts, request, folder, caller)
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    if isinstance(answer, RecordingBatch):
        return answer
    location = {"Location": f"/api/v1/jobs/{answer.id}"}
    return JSONResponse(job_of(answer).model_dump(mode="json"), status_code=202, headers=location)


@router.get("", summary="List recordings")
async def list_recordings(
    parts: AppParts,
    session_id: InSession = None,
    subject_id: OfSubject = None,
    linked: Linked = None,
    limit: Limit = 50,
    cursor: Cursor = None,
) -> Page[Recording]:
    """Recordings, newest first; with `session_id` or `subject_id` those of one session or subject."""
    query = recordings_with_subjects()
    if subject_id is not None:
        query = query.where(recording.c.subject_id == subject_id)
    if linked is not None:
        query = query.where(recording.c.subject_id.is_not(None) if linked else recording.c.subject_id.is_(None))
    if session_id is not None:
        query = query.where(recording.c.session_id == session_id)
    query = newest_first(query, recording, limit, cursor)
    async with parts.engine.connect() as connection:
        rows = (await connection.execute(query)).mappings().all()
    shown, following = cut(rows, limit)
    return Page[Recording](items=[recording_of(row) for row in shown], next=following)


@router.get("/{recording_id}", summary="One recording", responses=_UNKNOWN)
async def get_recording(parts: AppParts, recording_id: str) -> Recording:
    """What is known of a recording: rates, marker set, plates, windows, subject, and what to be careful about."""
    async with parts.engine.connect() as connection:
        return recording_of(await recording_row(connection, recording_id))


@router.patch(
    "/{recording_id}",
    summary="Change a recording",
    responses={
        **_UNKNOWN,
        **failures(s409="A sample of the program (`bundled-read-only`), or changed by another (`changed-meanwhile`)."),
    },
)
async def change_recording(
    parts: AppParts, recording_id: str, body: Annotated[RecordingPatch, Body(openapi_examples=_CHANGES)]
) -> Recording:
    """Change what the user states: subject, static trial, session, marker map, plate switches.

    Only the given fields change. A changed marker map or plate switch makes the file be read again.
    """
    return await service.change_recording(parts, recording_id, body)


@router.delete(
    "/{recording_id}",
    status_code=204,
    summary="Delete a recording",
    responses={**_UNKNOWN, **failures(s409="A sample that comes with the program (`bundled-read-only`).")},
)
async def delete_recording(
    parts: AppParts, caller: CallerOf, recording_id: str, response: Response, with_studies: WithStudies = False
) -> None:
    """Delete a recording of one's own with its jobs, their results and all files. Running jobs are cancelled.

    Studies of several recordings hold the person's name, height, mass, age and the file's name. `with_studies`
    deletes them as well; those that stay are named by the header `Stridelab-Kept-In`.
    """
    studies = await delete.studies_of(parts, [recording_id])
    await service.delete_recording(parts, recording_id, caller)
    if with_studies:
        studies = await delete.delete_studies(parts, studies, caller)
    if studies:
        response.headers[delete.KEPT_IN] = ", ".join(studies)


@router.get(
    "/{recording_id}/file",
    summary="The uploaded file",
    responses={**_UNKNOWN, **_FILE},
    response_class=StreamingResponse,
)
async def get_file(parts: AppParts, recording_id: str) -> StreamingResponse:
    """The file as it was uploaded, byte for byte."""
    async with parts.engine.connect() as connection:
        row = await recording_row(connection, recording_id)
    return await send_blob(parts, row["blob_key"], row["filename"], OCTETS)


@router.get(
    "/{recording_id}/tracks.parquet",
    summary="Markers and wrenches",
    responses={**_UNKNOWN, **_TABLE},
    response_class=StreamingResponse,
)
async def get_tracks(parts: AppParts, recording_id: str) -> StreamingResponse:
    """Markers and plate wrenches over time as Parquet: world frame, SI units, unit suffixes in the column names."""
    async with parts.engine.connect() as connection:
        row = await recording_row(connection, recording_id)
    return await send_blob(parts, row["tracks_key"], "tracks.parquet", PARQUET)
