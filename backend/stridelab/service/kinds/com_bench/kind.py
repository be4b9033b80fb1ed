"""The job kind ``com-bench``."""

from pathlib import Path

from sqlalchemy.ext.asyncio import AsyncConnection

from stridelab.schemas.comparison import BenchMember, ComBenchInput, ComBenchSummary, ComBenchTask
from stridelab.service.kinds.base import Blobs, JobKind, Json
from stridelab.service.kinds.staging import require_recordings, stage_members
from stridelab.service.samples.recording import SAMPLE_ID


async def stage(connection: AsyncConnection, blobs: Blobs, request: ComBenchInput, folder: Path) -> Json:
    """Fetch every recording into a separate folder. Raises as ``require_recordings`` does."""
    await require_recordings(connection, request.recording_ids)
    names = {row.recording_id: row.subject for row in request.subjects}
    members = [
        BenchMember.from_object(one, subject=names.get(one.recording_id) or one.task.recording.subject.name)
        for one in await stage_members(connection, blobs, request.recording_ids, None, folder)
    ]
    return ComBenchTask(members=members, seed=request.seed).model_dump(mode="json")


KIND = JobKind(
    name="com-bench",
    title="Estimators over many recordings",
    description=(
        "Scores all estimators of the centre of mass on many recordings by what none of them was given: the path of "
        "the force, a hidden plate, withheld force and flights, standing; means over people with intervals."
    ),
    examples={"one": {"summary": "The bundled recording", "value": {"recording_ids": [SAMPLE_ID]}}},
    input_model=ComBenchInput,
    summary_model=ComBenchSummary,
    stage=stage,
    timeout_s=3600.0,
    lane="long",
    spans_nodes=True,
)
