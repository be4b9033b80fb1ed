"""The job kind ``study-population``; recordings that occur twice are refused."""

from pathlib import Path
from typing import Final

from sqlalchemy.ext.asyncio import AsyncConnection

from stridelab.schemas.cycloid import FitCycloidInput, FitCycloidTask
from stridelab.schemas.population import (
    PersonFields,
    PopulationMember,
    StudyPopulationInput,
    StudyPopulationSummary,
    StudyPopulationTask,
    SubjectOfRecording,
)
from stridelab.service.kinds.base import Blobs, JobKind, Json
from stridelab.service.kinds.staging import require_recordings, stage_fit_cycloid
from stridelab.service.samples.recording import SAMPLE_ID

STATED_FIELDS: Final = ("height_m", "mass_kg", "sex", "age_years")


async def stage(connection: AsyncConnection, blobs: Blobs, request: StudyPopulationInput, folder: Path) -> Json:
    """Fetch every recording into a separate folder. Raises as ``require_recordings`` does."""
    await require_recordings(connection, request.recording_ids)
    table = {row.recording_id: row for row in request.subjects}
    members = []
    for index, recording_id in enumerate(request.recording_ids):
        name = f"recording-{index:03d}"
        (folder / name).mkdir()
        one = FitCycloidInput(recording_id=recording_id, method=request.method, steps=request.steps)
        staged = await stage_fit_cycloid(connection, blobs, one, folder / name)
        members.append(population_member(name, FitCycloidTask.model_validate(staged), table.get(recording_id)))
    task = StudyPopulationTask(members=members, pooled=request.pooled, seed=request.seed)
    return task.model_dump(mode="json")


def population_member(folder: str, task: FitCycloidTask, row: SubjectOfRecording | None) -> PopulationMember:
    """Member of the study: the recording in the sub-``folder`` with the subject's fields of the subject table."""
    person = PersonFields() if row is None else PersonFields(**row.model_dump(exclude={"recording_id"}))
    stated = {name: value for name in STATED_FIELDS if (value := getattr(person, name)) is not None}
    subject = task.recording.subject.model_copy(update=stated)
    source = task.recording.model_copy(update={"subject": subject})
    own = task.model_copy(update={"recording": source})
    return PopulationMember(recording_id=task.input.recording_id, folder=folder, task=own, person=person)


KIND = JobKind(
    name="study-population",
    title="Population",
    description="Fits the rolling wheels of many subjects: means per subject, correlations per group and mixed models.",
    examples={
        "one": {"summary": "One recording: means, and a warning", "value": {"recording_ids": [SAMPLE_ID]}},
        "table": {
            "summary": "With a subject table",
            "value": {
                "recording_ids": [SAMPLE_ID],
                "subjects": [{"recording_id": SAMPLE_ID, "subject": "P01", "group": "adults", "height_m": 1.71}],
            },
        },
    },
    input_model=StudyPopulationInput,
    summary_model=StudyPopulationSummary,
    stage=stage,
    timeout_s=900.0,
    lane="long",
    spans_nodes=True,
)
