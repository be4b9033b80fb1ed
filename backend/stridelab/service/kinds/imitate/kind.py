"""The job kind ``imitate``."""

from pathlib import Path

from sqlalchemy.ext.asyncio import AsyncConnection

from stridelab.schemas.imitation.contract import ImitateInput, ImitateSummary, ImitateTask
from stridelab.schemas.jobs import EstimateComInput
from stridelab.service.kinds.base import Blobs, JobKind, Json
from stridelab.service.kinds.staging import stage_estimate_com
from stridelab.service.samples.recording import SAMPLE_ID
from stridelab.service.stored_robots import stage_robot


async def stage(connection: AsyncConnection, blobs: Blobs, request: ImitateInput, folder: Path) -> Json:
    """Fetch the files of ``estimate-com``, and the robot if it is one of a user."""
    fields = {name: value for name, value in request.model_dump().items() if name in EstimateComInput.model_fields}
    staged = await stage_estimate_com(connection, blobs, EstimateComInput(**fields), folder)
    await stage_robot(connection, blobs, request.robot, folder)
    return ImitateTask(**(staged | {"input": request})).model_dump(mode="json")


KIND = JobKind(
    name="imitate",
    title="Imitation",
    description=(
        "Lets a robot walk as a recorded person does: scales footholds and times by the height of the hips, searches "
        "the longest steps and the fastest pace that are certified and replayed in physics, and compares both walks."
    ),
    examples={
        "talos": {"summary": "The bundled recording on TALOS", "value": {"recording_id": SAMPLE_ID, "robot": "talos"}}
    },
    input_model=ImitateInput,
    summary_model=ImitateSummary,
    stage=stage,
    timeout_s=1800.0,
    memory_mb=4096,
    lane="long",
)
