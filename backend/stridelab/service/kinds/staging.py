"""Staging that several job kinds share: from rows and blobs to a task.

Runs in the worker, so this module imports no numeric package.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from sqlalchemy import select
from sqlalchemy.ext.asyncio import AsyncConnection

from stridelab.errors import Fault, InvalidInput, NotFound
from stridelab.schemas.base import Contract
from stridelab.schemas.cycloid import FitCycloidInput, FitCycloidTask
from stridelab.schemas.jobs import EstimateComInput
from stridelab.schemas.measures import MeasuresMember
from stridelab.schemas.methods import Method
from stridelab.schemas.plans import PlanMotionInput, PlanMotionTask
from stridelab.schemas.receding import PlanRecedingTask, PushBasinTask
from stridelab.schemas.recordings import SubjectFields
from stridelab.schemas.scenarios import Scenario, ScenarioSource
from stridelab.schemas.sweeps import SweepTask
from stridelab.schemas.tasks import EstimateComTask, RecordingSource
from stridelab.service.kinds.base import Blobs, Json, Stage
from stridelab.service.kinds.session_staging import other_recordings, session_delays, session_of
from stridelab.service.storage.tables import recording, scenario, subject
from stridelab.service.stored_marker_sets import source_marker_sets
from stridelab.service.stored_robots import await_links, stage_links, stage_robot


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
    row = await recording_row(connection, request.recording_id)
    session = await session_of(connection, row)
    static = None
    if session.static is not None:
        static = await stage_recording(connection, blobs, session.static, folder, "static-trial")
    source = await stage_recording(connection, blobs, row, folder, "trial")
    task = EstimateComTask(recording=source, static=static, session=session.values, input=request)
    return task.model_dump(mode="json")


async def stage_members(
    connection: AsyncConnection, blobs: Blobs, recording_ids: Sequence[str], method: Method | None, folder: Path
) -> list[MeasuresMember]:
    """Fetch the files of ``estimate-com`` of every recording into a separate folder. Raises as ``recording_row``.

    Other recordings of their sessions give the delays of their events.
    """
    members = []
    rows = [await recording_row(connection, recording_id) for recording_id in recording_ids]
    files = {row["sha256"] for row in rows}
    for recording_id, row in zip(recording_ids, rows, strict=True):
        name = f"recording-{len(list(folder.glob('recording-*'))):03d}"
        (folder / name).mkdir()
        one = EstimateComInput(recording_id=recording_id, method=method)
        task = EstimateComTask.model_validate(await stage_estimate_com(connection, blobs, one, folder / name))
        others = [other for other in await other_recordings(connection, row) if other["sha256"] not in files]
        delays = session_delays(row, others, None if task.session is None else task.session.latency_s)
        members.append(
            MeasuresMember(
                recording_id=recording_id,
                folder=name,
                task=task,
                session_id=row["session_id"],
                session_delays=delays,
            )
        )
    return members


async def stage_fit_cycloid(connection: AsyncConnection, blobs: Blobs, input: Contract, folder: Path) -> Json:  # noqa: A002
    """Fetch the files of ``estimate-com``."""
    request = FitCycloidInput.model_validate(input.model_dump())
    staged = await stage_estimate_com(connection, blobs, EstimateComInput(**_estimate_com_fields(request)), folder)
    return FitCycloidTask(**(staged | {"input": request})).model_dump(mode="json")


async def stage_input(connection: AsyncConnection, blobs: Blobs, input: Contract, folder: Path) -> Json:  # noqa: A002
    """Fetch the robot, if the input names one of a user: otherwise the task is the input."""
    await stage_robot(connection, blobs, getattr(input, "robot", None), folder)
    return {"input": input.model_dump(mode="json")}


def stage_scenario(task_model: type[PlanMotionTask | PlanRecedingTask | PushBasinTask | SweepTask]) -> Stage:
    """Stage function that copies the scenario of a request, or the present body of the stored one, into the task."""

    async def stage(connection: AsyncConnection, blobs: Blobs, request: Contract, folder: Path) -> Json:
        if not isinstance(request, ScenarioSource):
            raise TypeError(f"{type(request).__name__} has no scenario")
        scenario = request.scenario or await _stored_scenario(connection, request.scenario_id)
        name = getattr(request, "robot", None) or scenario.robot
        await stage_robot(connection, blobs, name, folder)
        if isinstance(request, PlanMotionInput) and request.whole_body:  # writes files with the robot's shape
            await stage_links(connection, blobs, name, folder)
        return task_model.model_validate({"scenario": scenario, "input": request}).model_dump(mode="json")

    return stage


async def await_robot_links(blobs: Blobs, task: Json, folder: Path) -> None:
    """Fetch the display meshes of the robot of a ``PlanMotionTask`` as soon as they are stored."""
    if task["input"]["whole_body"]:
        await await_links(blobs, task["scenario"]["robot"], folder)


async def _stored_scenario(connection: AsyncConnection, scenario_id: str | None) -> Scenario:
    """A stored scenario as it is now: later changes of its row have no effect on the job.

    Raises ``NotFound`` (``scenario-not-found``) if the scenario has been deleted since the job was accepted.
    """
    result = await connection.execute(select(scenario.c.body).where(scenario.c.id == scenario_id))
    body = result.scalar_one_or_none()
    if body is None:
        raise NotFound(
            "scenario-not-found",
            f"There is no scenario {scenario_id}; it may have been deleted since the job was accepted.",
            [Fault("scenario_id", "unknown")],
        )
    return Scenario.model_validate(body)


def _estimate_com_fields(request: EstimateComInput) -> dict[str, Any]:
    """The fields of a kind's input that belong to ``estimate-com``."""
    return {name: value for name, value in request.model_dump().items() if name in EstimateComInput.model_fields}


async def recording_row(connection: AsyncConnection, recording_id: str) -> Mapping[str, Any]:
    """Row of a recording.

    Raises ``NotFound`` (``recording-not-found``) if it has been deleted since the job was accepted.
    """
    result = await connection.execute(select(recording).where(recording.c.id == recording_id))
    row = result.mappings().one_or_none()
    if row is None:
        raise NotFound(
            "recording-not-found",
            f"There is no recording {recording_id}; it may have been deleted since the job was accepted.",
            [Fault("recording_id", "unknown")],
        )
    return dict(row)


async def stage_recording(
    connection: AsyncConnection, blobs: Blobs, row: Mapping[str, Any], folder: Path, name: str
) -> RecordingSource:
    """Fetch the file of a recording's row as ``folder / name``, with the subject and the switches that users stated.

    Raises ``InvalidInput`` (``stored-switches-invalid``).
    """
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
            marker_sets=await source_marker_sets(connection, row["owner"]),
        )
    except ValueError as error:
        message = f"The settings stored for {row['filename']} are invalid."
        raise InvalidInput("stored-switches-invalid", message) from error


async def require_recordings(
    connection: AsyncConnection, recording_ids: Sequence[str], name: str = "recording_ids"
) -> None:
    """Raise ``NotFound`` (``recording-not-found``) naming unknown ids, ``InvalidInput`` (``recording-twice``).

    Two recordings with identical files count as one recording. ``name`` is the field of the request.
    """
    query = select(recording.c.id, recording.c.sha256, recording.c.filename)
    query = query.where(recording.c.id.in_(recording_ids))
    rows = {row.id: row for row in (await connection.execute(query)).all()}
    places = {recording_id: f"{name}.{i}" for i, recording_id in enumerate(recording_ids)}
    missing = [recording_id for recording_id in recording_ids if recording_id not in rows]
    if missing:
        raise NotFound(
            "recording-not-found",
            f"There is no recording with {'this id' if len(missing) == 1 else 'these ids'}: "
            f"{', '.join(i[:64] for i in missing[:5])}; deleted, or never uploaded.",
            [Fault(places[recording_id], "unknown") for recording_id in missing],
        )
    first: dict[str, str] = {}
    for recording_id in recording_ids:
        row = rows[recording_id]
        before = first.setdefault(row.sha256, recording_id)
        if before != recording_id:
            raise InvalidInput(
                "recording-twice",
                f"{row.filename} is the same file as {rows[before].filename}: a recording counts once.",
                [Fault(places[recording_id], f"the same file as {before}")],
            )
