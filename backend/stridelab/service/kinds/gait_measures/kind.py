"""The job kind ``gait-measures``."""

from pathlib import Path

from sqlalchemy.ext.asyncio import AsyncConnection

from stridelab.schemas.measures import GaitMeasuresInput, GaitMeasuresSummary, GaitMeasuresTask
from stridelab.service.kinds.base import Blobs, JobKind, Json
from stridelab.service.kinds.staging import require_recordings, stage_members
from stridelab.service.samples.recording import SAMPLE_ID


async def stage(connection: AsyncConnection, blobs: Blobs, request: GaitMeasuresInput, folder: Path) -> Json:
    """Fetch every recording into a separate folder. Raises as ``require_recordings`` does."""
    await require_recordings(connection, request.recording_ids)
    members = await stage_members(connection, blobs, request.recording_ids, request.method, folder)
    return GaitMeasuresTask(members=members).model_dump(mode="json")


KIND = JobKind(
    name="gait-measures",
    title="Gait measures",
    description=(
        "Computes measures of gait per step, with their errors: margins of stability, steps, energy exchange, work of "
        "the legs, angular momentum and foot placement, pooled over the recordings."
    ),
    examples={"one": {"summary": "The bundled recording", "value": {"recording_ids": [SAMPLE_ID]}}},
    input_model=GaitMeasuresInput,
    summary_model=GaitMeasuresSummary,
    stage=stage,
    timeout_s=600.0,
    lane="long",
)
