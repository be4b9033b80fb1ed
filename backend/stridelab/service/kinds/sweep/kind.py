"""The job kind ``sweep``."""

from pathlib import Path

from sqlalchemy.ext.asyncio import AsyncConnection

from stridelab.schemas.base import Contract
from stridelab.schemas.sweeps import SweepInput, SweepSummary
from stridelab.schemas.tasks import SweepTask
from stridelab.service.kinds.base import Blobs, JobKind, Json
from stridelab.service.kinds.staging import scenario_of
from stridelab.service.samples.scenarios import EXAMPLE_ID


async def stage(connection: AsyncConnection, blobs: Blobs, input: Contract, folder: Path) -> Json:  # noqa: A002
    """Copy the scenario's present body into the task. Raises as ``scenario_of`` does."""
    request = SweepInput.model_validate(input.model_dump())
    scenario = await scenario_of(connection, request.scenario, request.scenario_id)
    return SweepTask(scenario=scenario, input=request).model_dump(mode="json")


KIND = JobKind(
    name="sweep",
    title="Sweep",
    description="Plans a scenario for every combination of up to three varied parameters, in parallel over the cores.",
    examples={
        "strides": {
            "summary": "Feasible stride length as a function of friction",
            "value": {"scenario_id": EXAMPLE_ID, "vary": {"stride": [0.3, 0.9, 4], "friction": [0.2, 0.6, 3]}},
        },
    },
    input_model=SweepInput,
    summary_model=SweepSummary,
    run="stridelab.service.kinds.sweep.run:run_in_child",
    stage=stage,
    timeout_s=7200.0,
    memory_mb=8192,
    lane="long",
)
