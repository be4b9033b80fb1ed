"""The job kind ``compare-estimators``."""

from pathlib import Path

from sqlalchemy import select
from sqlalchemy.ext.asyncio import AsyncConnection

from stridelab.schemas.comparison import CompareEstimatorsInput, CompareEstimatorsSummary, CompareEstimatorsTask
from stridelab.service.kinds.base import Blobs, JobKind, Json
from stridelab.service.kinds.simulate_recording.kind import TRUTH_FILE
from stridelab.service.kinds.staging import stage_estimate_com
from stridelab.service.samples.recording import SAMPLE_ID
from stridelab.service.storage.tables import job, recording


async def stage(connection: AsyncConnection, blobs: Blobs, request: CompareEstimatorsInput, folder: Path) -> Json:
    """Fetch the files of ``estimate-com``, and the ground truth of a simulated recording."""
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


KIND = JobKind(
    name="compare-estimators",
    title="Comparison of methods",
    description="Runs every estimator on one recording: errors against the ground truth where it is known, agreement "
    "with physics, and spectra.",
    examples={
        "default": {
            "summary": "All estimators, on a recording with known ground truth",
            "value": {"recording_id": SAMPLE_ID, "latency": "apply"},
        },
    },
    input_model=CompareEstimatorsInput,
    summary_model=CompareEstimatorsSummary,
    stage=stage,
    timeout_s=300.0,
)
