"""Endpoints of recordings: upload, list, read, change, download, delete."""

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
from stridelab.service.api.openapi import failure_responses, file_response, form_body
from stridelab.service.api.pagination import Cursor, Limit, Order, Search, Sort, read_page
from stridelab.service.api.recordings import service
from stridelab.service.api.recordings.batch import receive_batch
from stridelab.service.api.recordings.form_fields import session_of_form, subject_of_form
from stridelab.service.api.recordings.multipart import Limits, receive_form
from stridelab.service.api.recordings.parse import NO_SWITCHES, parse_recording
from stridelab.service.api.recordings.repository import (
    SEARCHED_COLUMNS,
    recording_of,
    recording_row,
    recordings_with_subjects,
)
from stridelab.service.api.strict_json import StrictRoute
from stridelab.service.storage.search import contains_words
from stridelab.service.storage.tables import recording

REUSED_HEADER: Final = "Stridelab-Reused"
"""Response header of an upload that was not stored because a recording of the same bytes exists."""
ESTIMATE_HEADER: Final = "Stridelab-Estimate"
"""Response header of an upload whose estimate was started: the id of its job."""
Reuse = Annotated[
    bool,
    Query(
        description="if you have uploaded the same bytes before, return the newest of these recordings unchanged: "
        "nothing is stored, and the other fields of the form are ignored"
    ),
]
WithStudies = Annotated[
    bool, Query(description="also delete one's own finished studies that contain data of the subject")
]

router = APIRouter(prefix="/recordings", tags=["recordings"], route_class=StrictRoute)


_FORM: Final = form_body(
    {
        "file": {
            "type": "string",
            "format": "binary",
            "description": "a .c3d, .trc, .tsv, .csv or .mvnx file, or a .zip of one trial",
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
            "description": "trials of one person on one day; by default determined by the service",
        },
    },
    "file",
)
_BATCH: Final = form_body(
    {
        "file": {
            "type": "array",
            "items": {"type": "string", "format": "binary"},
            "description": "recordings as for `POST /recordings`, and .zip files of recordings",
        },
        "subjects": {
            "type": "string",
            "description": "CSV: file, subject, group, height_m, mass_kg, sex, age, static",
        },
    },
    "file",
)
_CHANGES: Final[Any] = {
    "subject": {"summary": "Set height and sex", "value": {"subject": {"height_m": 1.71, "sex": "female"}}},
    "plate": {
        "summary": "Exclude the second plate, raise the threshold of the first",
        "value": {"plates": {"2": {"use": False}, "1": {"threshold_n": 30.0}}},
    },
    "reset": {"summary": "Reset all switches", "value": {"plates": None, "marker_map": None}},
}
InSession = Annotated[
    str | None, Query(max_length=64, pattern=r"^[A-Za-z0-9._-]*$", description="only recordings of this session")
]
OfSubject = Annotated[
    str | None, Query(max_length=64, pattern=r"^[A-Za-z0-9_-]*$", description="only recordings of this subject")
]
Linked = Annotated[bool | None, Query(description="true: only recordings linked to a subject; false: only the others")]
_UNKNOWN: Final = failure_responses(s404="No recording with this id (`recording-not-found`).")
_FILE: Final = file_response("The file.", OCTETS)
_TABLE: Final = file_response("The table.", PARQUET)


@router.post(
    "",
    status_code=201,
    summary="Upload a recording",
    openapi_extra=_FORM,
    responses=failure_responses(
        s413="The file exceeds the size limit (`upload-too-large`) or your storage limit (`storage-limit`).",
        s422="The file cannot be read (for example `unreadable-file`, `empty-file`), or a field is not valid.",
        s507="No disk space is left (`disk-full`).",
    ),
)
async def upload_recording(
    parts: AppParts, caller: CallerOf, request: Request, response: Response, reuse: Reuse = False
) -> Recording:
    """Upload a `.c3d`, `.trc`, `.tsv`, `.csv` or `.mvnx` file, or a `.zip`, as the form field `file`.

    A `.tsv` is an export of Qualisys, a `.csv` one of Vicon Nexus, and a `.zip` holds `.trc` and `.mot`/`.sto`, the
    `.tsv` of the markers and those of the plates, or an OpenSim model `.osim` with its joint angles and forces
    (`.mot`/`.sto`). A `.trc`, `.tsv` or `.mvnx` alone contains no forces: of the methods of `estimate-com`, only
    `geometry` accepts it.

    The file is parsed before the response: 201 means that it was parsed and stored. An unreadable file is refused with
    the reason and not stored. Uploading the same bytes again creates another recording, unless `reuse` is set: then
    the existing recording is returned, with the header `Stridelab-Reused`.

    If the setting `STRIDELAB_ESTIMATE_UPLOADS` is true, `estimate-com` starts with its default method; the header
    `Stridelab-Estimate` has the id of this job.
    """
    limits = Limits(parts.settings.max_upload_mb * 1_000_000, parts.settings.min_free_disk_mb * 1_000_000)
    folder = service.spool_folder(parts)
    try:
        form = await receive_form(request, folder / "trial", limits)
        subject, session_id = subject_of_form(form.fields), session_of_form(form.fields)
        existing = await service.uploaded_before(parts, form, caller.name) if reuse else None
        if existing is not None:
            response.headers.update({"Location": f"/api/v1/recordings/{existing.id}", REUSED_HEADER: "true"})
            return existing
        parsed = await parse_recording(parts, folder, form.path.name, form.filename, NO_SWITCHES, owner=caller.name)
        stored = await service.store_upload(parts, form, parsed, subject, caller.name, session_id)
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    response.headers["Location"] = f"/api/v1/recordings/{stored.id}"
    if parts.settings.estimate_uploads and (job_id := await service.start_estimate(parts, stored, caller.name)):
        response.headers[ESTIMATE_HEADER] = job_id
    return stored


@router.post(
    "/batch",
    status_code=201,
    summary="Upload many recordings",
    openapi_extra=_BATCH,
    response_model=RecordingBatch,
    responses={
        202: {"model": Job, "description": "A job reads the files; the summary of its result is a ReadBatchSummary."},
        **failure_responses(
            s413="The files exceed the size limit (`upload-too-large`) or your storage limit (`storage-limit`).",
            s422="No file can be read (`nothing-readable`), or a zip or the table is invalid.",
            s429="Too many jobs are queued (`queue-full`), or too many of yours (`user-queue-full`).",
            s507="No disk space is left (`disk-full`).",
        ),
    },
)
async def upload_recordings(parts: AppParts, caller: CallerOf, request: Request) -> RecordingBatch | Response:
    """Upload many recordings, or zips of them, with one subject table.

    Readable files are stored, the others are listed in `refused`; an invalid zip or table refuses the whole upload.
    An upload of more than 20 files or 20 MB, or one that takes longer than `STRIDELAB_BATCH_ANSWER_S` to read, is
    answered with 202 and the job that reads it (`Location`).
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
    search: Search = None,
    sort: Sort = "newest",
    limit: Limit = 50,
    cursor: Cursor = None,
) -> Page[Recording]:
    """List recordings, optionally of one session or subject.

    `search` looks in the file name, the pseudonym of the subject, the session and the marker set.
    """
    query = recordings_with_subjects()
    if search is not None:
        query = query.where(contains_words(search, *SEARCHED_COLUMNS))
    if subject_id is not None:
        query = query.where(recording.c.subject_id == subject_id)
    if linked is not None:
        query = query.where(recording.c.subject_id.is_not(None) if linked else recording.c.subject_id.is_(None))
    if session_id is not None:
        query = query.where(recording.c.session_id == session_id)
    rows, following = await read_page(parts.engine, query, Order(recording, sort, recording.c.filename), limit, cursor)
    return Page[Recording](items=[recording_of(row) for row in rows], next=following)


@router.get("/{recording_id}", summary="One recording", responses=_UNKNOWN)
async def get_recording(parts: AppParts, recording_id: str) -> Recording:
    """One recording: sampling rates, marker set, force plates, windows of complete force, subject, and warnings."""
    async with parts.engine.connect() as connection:
        return recording_of(await recording_row(connection, recording_id))


@router.patch(
    "/{recording_id}",
    summary="Change a recording",
    responses={
        **_UNKNOWN,
        **failure_responses(
            s409="A bundled sample (`bundled-read-only`), or changed concurrently (`changed-meanwhile`)."
        ),
    },
)
async def change_recording(
    parts: AppParts, recording_id: str, body: Annotated[RecordingPatch, Body(openapi_examples=_CHANGES)]
) -> Recording:
    """Change the fields stated by the user: subject, static trial, session, marker map, plate switches.

    Only the given fields change. A change of the marker map or of a plate switch parses the file again.
    """
    return await service.change_recording(parts, recording_id, body)


@router.delete(
    "/{recording_id}",
    status_code=204,
    summary="Delete a recording",
    responses={**_UNKNOWN, **failure_responses(s409="A bundled sample (`bundled-read-only`).")},
)
async def delete_recording(
    parts: AppParts, caller: CallerOf, recording_id: str, response: Response, with_studies: WithStudies = False
) -> None:
    """Delete one's own recording with its jobs, their results and all files. Running jobs are cancelled.

    Studies of several recordings contain the subject's name, height, mass and age, and the file's name. `with_studies`
    deletes them as well; the header `Stridelab-Kept-In` lists those that remain.
    """
    studies = await delete.studies_of(parts, [recording_id])
    await service.delete_recording(parts, recording_id, caller)
    if with_studies:
        studies = await delete.delete_studies(parts, studies, caller)
    if studies:
        response.headers[delete.REMAINING_JOBS_HEADER] = ", ".join(studies)


@router.get(
    "/{recording_id}/file",
    summary="The uploaded file",
    responses={**_UNKNOWN, **_FILE},
    response_class=StreamingResponse,
)
async def get_file(parts: AppParts, recording_id: str) -> StreamingResponse:
    """Download the uploaded file, byte for byte."""
    async with parts.engine.connect() as connection:
        row = await recording_row(connection, recording_id)
    return await send_blob(parts, row["blob_key"], row["filename"], OCTETS, n_bytes=row["bytes"])


@router.get(
    "/{recording_id}/tracks.parquet",
    summary="Markers and wrenches",
    responses={**_UNKNOWN, **_TABLE},
    response_class=StreamingResponse,
)
async def get_tracks(parts: AppParts, recording_id: str) -> StreamingResponse:
    """Download markers and plate wrenches as Parquet: world frame, SI units, unit suffixes in the column names."""
    async with parts.engine.connect() as connection:
        row = await recording_row(connection, recording_id)
    return await send_blob(parts, row["tracks_key"], "tracks.parquet", PARQUET)
