"""The job kind ``study-population``; recordings that occur twice are refused."""

from pathlib import Path
from typing import Final

from sqlalchemy import select
from sqlalchemy.ext.asyncio import AsyncConnection

from stridelab.errors import Fault, InvalidInput, NotFound
from stridelab.schemas.base import Contract
from stridelab.schemas.cycloid import FitCycloidInput
from stridelab.schemas.population import PersonFields, StudyPopulationInput, StudyPopulationSummary, SubjectOfRecording
from stridelab.schemas.tasks import FitCycloidTask, PopulationMember, StudyPopulationTask
from stridelab.service.kinds.base import Blobs, JobKind, Json
from stridelab.service.kinds.staging import stage_fit_cycloid
from stridelab.service.samples.recording import SAMPLE_ID
from stridelab.service.storage.tables import recording

STATED_FIELDS: Final = ("height_m", "mass_kg", "sex", "age_years")


async def require_recordings(connection: AsyncConnection, request: StudyPopulationInput) -> None:
    """Raise ``NotFound`` (``recording-not-found``) naming unknown ids, ``InvalidInput`` (``recording-twice``).

    Two recordings with identical files count as one recording.
    """
    query = select(recording.c.id, recording.c.sha256, recording.c.filename).where(
        recording.c.id.in_(request.recording_ids)
    )
    rows = {row.id: row for row in (await connection.execute(query)).all()}
    places = {recording_id: f"recording_ids.{i}" for i, recording_id in enumerate(request.recording_ids)}
    missing = [recording_id for recording_id in request.recording_ids if recording_id not in rows]
    if missing:
        raise NotFound(
            "recording-not-found",
            f"There is no recording with {'this id' if len(missing) == 1 else 'these ids'}: "
            f"{', '.join(i[:64] for i in missing[:5])}; deleted, or never uploaded.",
            [Fault(places[recording_id], "unknown") for recording_id in missing],
        )
    first: dict[str, str] = {}
    for recording_id in request.recording_ids:
        row = rows[recording_id]
        before = first.setdefault(row.sha256, recording_id)
        if before != recording_id:
            raise InvalidInput(
                "recording-twice",
                f"{row.filename} is the same file as {rows[before].filename}: a recording counts once.",
                [Fault(places[recording_id], f"the same file as {before}")],
            )


async def stage(connection: AsyncConnection, blobs: Blobs, input: Contract, folder: Path) -> Json:  # noqa: A002
    """Fetch every recording into a separate folder. Raises as ``require_recordings`` does."""
    request = StudyPopulationInput.model_validate(input.model_dump())
    await require_recordings(connection, request)
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
    run="stridelab.service.kinds.study_population.run:run_in_child",
    stage=stage,
    timeout_s=900.0,
    lane="long",
)
