"""Stages jobs (from rows and blobs to a task) and publishes simulated recordings (from files to a row).

Runs in the worker, so this module imports no numeric package.
"""

import hashlib
import uuid
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from sqlalchemy import insert, select
from sqlalchemy.ext.asyncio import AsyncConnection

from stridelab.errors import Fault, InvalidInput, NotFound
from stridelab.schemas.base import Contract
from stridelab.schemas.comparison import CompareEstimatorsInput
from stridelab.schemas.cycloid import FitCycloidInput
from stridelab.schemas.jobs import EstimateComInput
from stridelab.schemas.plans import PlanMotionInput
from stridelab.schemas.receding import PlanRecedingInput
from stridelab.schemas.recordings import RecordingFacts, SubjectFields
from stridelab.schemas.scenarios import Scenario
from stridelab.schemas.sweeps import SweepInput
from stridelab.schemas.tasks import (
    CompareEstimatorsTask,
    EstimateComTask,
    FitCycloidTask,
    PlanMotionTask,
    PlanRecedingTask,
    RecordingSource,
    SweepTask,
)
from stridelab.service.kinds.base import Blobs, Json
from stridelab.service.kinds.session_staging import session_of
from stridelab.service.storage.content_addressed import lock_blob
from stridelab.service.storage.tables import job, recording, scenario, subject

RECORDING_FILE, TRACKS_FILE, FACTS_FILE = "recording.c3d", "tracks.parquet", "facts.json"
"""Files of ``simulate-recording``: its recording, and the tracks and facts for the recording's row."""
TRUTH_FILE = "truth.parquet"
"""The true motion of a simulated recording, an artifact of the simulation job."""


def stated_subject(recording_fields: Mapping[str, Any], subject_fields: Mapping[str, Any] | None) -> SubjectFields:
    """Fields stated by users: those of the recording take precedence over those of the linked subject."""
    merged = {key: value for key, value in (subject_fields or {}).items() if value is not None}
    merged.update({key: value for key, value in recording_fields.items() if value is not None})
    return SubjectFields.model_validate(merged)


async def stage_estimate_com(connection: AsyncConnection, blobs: Blobs, input: Contract, folder: Path) -> Json:  # noqa: A002
    """Fetch the recording, the values of its session, and its static trial: the stated one, else the session's.

    Raises ``NotFound`` (``recording-not-found``) if the recording has been deleted since the job was accepted.
    """
    request = EstimateComInput.model_validate(input.model_dump())
    row = await _recording_row(connection, request.recording_id)
    session = await session_of(connection, row)
    static = None
    if session.static is not None:
        static = await _stage_recording(connection, blobs, session.static, folder, "static-trial")
    source = await _stage_recording(connection, blobs, row, folder, "trial")
    task = EstimateComTask(recording=source, static=static, session=session.values, input=request)
    return task.model_dump(mode="json")


async def stage_compare_estimators(connection: AsyncConnection, blobs: Blobs, input: Contract, folder: Path) -> Json:  # noqa: A002
    """Fetch the files of ``estimate-com``, and the ground truth of a simulated recording."""
    request = CompareEstimatorsInput.model_validate(input.model_dump())
    staged = await stage_estimate_com(connection, blobs, request, folder)
    prefix = await connection.execute(
        select(job.c.blob_prefix)
        .join(recording, recording.c.truth_job_id == job.c.id)
        .where(recording.c.id == request.recording_id)
    )
    truth = None
    if (blob_prefix := prefix.scalar_one_or_none()) is not None:
        truth = TRUTH_FILE
        await blobs.get_file(f"{blob_prefix}/{TRUTH_FILE}", folder / truth)
    task = CompareEstimatorsTask(**(staged | {"input": request, "truth": truth}))
    return task.model_dump(mode="json")


async def stage_fit_cycloid(connection: AsyncConnection, blobs: Blobs, input: Contract, folder: Path) -> Json:  # noqa: A002
    """Fetch the files of ``estimate-com``."""
    request = FitCycloidInput.model_validate(input.model_dump())
    staged = await stage_estimate_com(connection, blobs, EstimateComInput(**_estimate_com_fields(request)), folder)
    return FitCycloidTask(**(staged | {"input": request})).model_dump(mode="json")


async def stage_input(connection: AsyncConnection, blobs: Blobs, input: Contract, folder: Path) -> Json:  # noqa: A002
    """Nothing to fetch: the task is the input."""
    return {"input": input.model_dump(mode="json")}


async def stage_plan_motion(connection: AsyncConnection, blobs: Blobs, input: Contract, folder: Path) -> Json:  # noqa: A002
    """Copy the scenario's present body into the task, so that later changes of the row have no effect.

    Raises ``NotFound`` (``scenario-not-found``) if the scenario has been deleted since the job was accepted.
    """
    request = PlanMotionInput.model_validate(input.model_dump())
    body = request.scenario or await _scenario_body(connection, str(request.scenario_id))
    return PlanMotionTask(scenario=body, input=request).model_dump(mode="json")


async def stage_plan_receding(connection: AsyncConnection, blobs: Blobs, input: Contract, folder: Path) -> Json:  # noqa: A002
    """As for ``plan-motion``."""
    request = PlanRecedingInput.model_validate(input.model_dump())
    body = request.scenario or await _scenario_body(connection, str(request.scenario_id))
    return PlanRecedingTask(scenario=body, input=request).model_dump(mode="json")


async def stage_sweep(connection: AsyncConnection, blobs: Blobs, input: Contract, folder: Path) -> Json:  # noqa: A002
    """As for ``plan-motion``."""
    request = SweepInput.model_validate(input.model_dump())
    body = request.scenario or await _scenario_body(connection, str(request.scenario_id))
    return SweepTask(scenario=body, input=request).model_dump(mode="json")


async def publish_simulated_recording(
    connection: AsyncConnection, blobs: Blobs, job_row: Mapping[str, Any], outcome: Json, folder: Path
) -> Json:
    """Insert the recording of a finished simulation; returns the summary with its ``recording_id``.

    The id is derived from the job's id, so that the files of an attempt that died before committing the row are
    overwritten by the next attempt and leave no orphans.
    """
    recording_id = uuid.uuid5(uuid.NAMESPACE_URL, f"stridelab:job:{job_row['id']}").hex
    trial, tracks = folder / RECORDING_FILE, folder / TRACKS_FILE
    facts = RecordingFacts.model_validate_json((folder / FACTS_FILE).read_text(encoding="utf-8"))
    blob_key, tracks_key = f"recordings/{recording_id}/{RECORDING_FILE}", f"recordings/{recording_id}/{TRACKS_FILE}"
    for key, file in ((blob_key, trial), (tracks_key, tracks)):
        await lock_blob(connection, key)  # the janitor waits for the commit
        await blobs.put_file(key, file)
    content = trial.read_bytes()
    await connection.execute(
        insert(recording).values(
            id=recording_id,
            owner=job_row["owner"],
            filename=f"simulated-{job_row['input'].get('robot', 'human')}-seed-{job_row['input'].get('seed', 0)}.c3d",
            sha256=hashlib.sha256(content).hexdigest(),
            bytes=len(content),
            blob_key=blob_key,
            tracks_key=tracks_key,
            facts=facts.model_dump(mode="json"),
            subject_fields={},
            truth_job_id=job_row["id"],
        )
    )
    return {**outcome["summary"], "recording_id": recording_id}


def _estimate_com_fields(request: EstimateComInput) -> dict[str, Any]:
    """The fields of a kind's input that belong to ``estimate-com``."""
    return {name: value for name, value in request.model_dump().items() if name in EstimateComInput.model_fields}


async def _recording_row(connection: AsyncConnection, recording_id: str) -> Mapping[str, Any]:
    result = await connection.execute(select(recording).where(recording.c.id == recording_id))
    row = result.mappings().one_or_none()
    if row is None:
        raise NotFound(
            "recording-not-found",
            f"There is no recording {recording_id}; it may have been deleted since the job was accepted.",
            [Fault("recording_id", "unknown")],
        )
    return dict(row)


async def _scenario_body(connection: AsyncConnection, scenario_id: str) -> Scenario:
    result = await connection.execute(select(scenario.c.body).where(scenario.c.id == scenario_id))
    body = result.scalar_one_or_none()
    if body is None:
        raise NotFound(
            "scenario-not-found",
            f"There is no scenario {scenario_id}; it may have been deleted since the job was accepted.",
            [Fault("scenario_id", "unknown")],
        )
    return Scenario.model_validate(body)


async def _stage_recording(
    connection: AsyncConnection, blobs: Blobs, row: Mapping[str, Any], folder: Path, name: str
) -> RecordingSource:
    linked = None
    if row["subject_id"] is not None:
        result = await connection.execute(select(subject.c.fields).where(subject.c.id == row["subject_id"]))
        linked = result.scalar_one_or_none()
    await blobs.get_file(row["blob_key"], folder / name, row["sha256"])
    try:
        return RecordingSource(
            file=name,
            filename=row["filename"],
            subject=stated_subject(row["subject_fields"], linked),
            marker_map=row["marker_map"],
            plates=row["plate_switches"],
        )
    except ValueError as error:
        message = f"The settings stored for {row['filename']} are invalid."
        raise InvalidInput("stored-switches-invalid", message) from error
