"""The job kind ``plan-receding``."""

from pathlib import Path

from sqlalchemy.ext.asyncio import AsyncConnection

from stridelab.schemas.base import Contract
from stridelab.schemas.receding import PlanRecedingInput, PlanRecedingSummary
from stridelab.schemas.tasks import PlanRecedingTask
from stridelab.service.kinds.base import Blobs, JobKind, Json
from stridelab.service.kinds.plan_motion.kind import FILMING
from stridelab.service.kinds.staging import scenario_of
from stridelab.service.samples.scenarios import EXAMPLE_ID


async def stage(connection: AsyncConnection, blobs: Blobs, input: Contract, folder: Path) -> Json:  # noqa: A002
    """Copy the scenario's present body into the task. Raises as ``scenario_of`` does."""
    request = PlanRecedingInput.model_validate(input.model_dump())
    scenario = await scenario_of(connection, request.scenario, request.scenario_id)
    return PlanRecedingTask(scenario=scenario, input=request).model_dump(mode="json")


KIND = JobKind(
    name="plan-receding",
    title="Receding horizon",
    description="Executes a scenario with a receding horizon: the motion is planned anew in every period, optionally "
    "with pushes.",
    examples={
        "pushed": {
            "summary": "Pushed to the left after two seconds",
            "value": {"scenario_id": EXAMPLE_ID, "pushes": [{"time_s": 2.0, "velocity_m_s": [0.0, 0.1, 0.0]}]},
        },
    },
    input_model=PlanRecedingInput,
    summary_model=PlanRecedingSummary,
    run="stridelab.service.kinds.plan_receding.run:run_in_child",
    stage=stage,
    timeout_s=600.0,
    memory_mb=4096,
    lane="long",
    sandbox=FILMING,
)
