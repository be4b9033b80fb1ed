"""The job kind ``gait-report``; the session of a request is replaced by its recordings before the job is stored."""

import contextlib
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from sqlalchemy.ext.asyncio import AsyncConnection

from stridelab.schemas.measures import GaitReportInput, GaitReportSummary, GaitReportTask, ReferencePerson
from stridelab.schemas.recordings import RecordingFacts
from stridelab.service.kinds.base import Blobs, JobKind, Json
from stridelab.service.kinds.staging import recording_row, require_recordings, stage_members
from stridelab.service.recording_sessions import subject_key
from stridelab.service.samples.recording import SAMPLE_ID
from stridelab.service.settings import Settings, current_settings

LOGO: Final = "lab-logo"
LOGO_BYTES: Final = 1_000_000
"""Bytes of a logo that are fetched: more than a report accepts."""


async def stage(connection: AsyncConnection, blobs: Blobs, request: GaitReportInput, folder: Path) -> Json:
    """Fetch all recordings; those of the reference group by person. Raises as ``require_recordings`` does."""
    groups = (request.recording_ids or [], request.reference_recording_ids, request.before_recording_ids)
    for ids in groups:
        await require_recordings(connection, ids)
    people: dict[tuple[str, ...], list[str]] = {}
    for recording_id in request.reference_recording_ids:
        row = await recording_row(connection, recording_id)
        facts = RecordingFacts.model_validate(row["facts"])
        person = subject_key(facts, row["subject_id"], row["subject_fields"]) or ("recording", recording_id)
        people.setdefault((row["owner"] or "", *person), []).append(recording_id)
    members, before = [
        await stage_members(connection, blobs, ids, request.method, folder) for ids in (groups[0], groups[2])
    ]
    reference = [
        ReferencePerson(members=await stage_members(connection, blobs, ids, request.method, folder))
        for ids in people.values()
    ]
    settings = current_settings()
    task = GaitReportTask(
        members=members,
        before=before,
        reference=reference,
        input=request,
        created_on=datetime.now(UTC).date(),
        lab_name=settings.lab_name,
        logo=stage_logo(settings, folder),
    )
    return task.model_dump(mode="json")


def stage_logo(settings: Settings, folder: Path) -> str | None:
    """Copy the logo of the settings into ``folder``; a file that cannot be read is found missing by the report."""
    if settings.lab_logo is None:
        return None
    with contextlib.suppress(OSError), settings.lab_logo.open("rb") as file:
        (folder / LOGO).write_bytes(file.read(LOGO_BYTES))
    return LOGO


KIND = JobKind(
    name="gait-report",
    title="Gait report",
    description=(
        "Writes a report on the gait of a person, as a page of HTML and as PDF: headline, curves over the gait cycle, "
        "measures per side with intervals, what is not measured and why, recordings, settings and references; "
        "optionally beside a reference group, and the change since earlier recordings."
    ),
    examples={
        "one": {"summary": "The bundled recording", "value": {"recording_ids": [SAMPLE_ID], "title": "Sample walk"}},
    },
    input_model=GaitReportInput,
    summary_model=GaitReportSummary,
    stage=stage,
    timeout_s=900.0,
    lane="long",
)
