"""The job kind ``plan-receding``."""

from stridelab.schemas.receding import PlanRecedingInput, PlanRecedingSummary, PlanRecedingTask
from stridelab.service.kinds.base import JobKind
from stridelab.service.kinds.plan_motion.kind import FILMING
from stridelab.service.kinds.staging import stage_scenario
from stridelab.service.samples.scenarios import EXAMPLE_ID

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
    stage=stage_scenario(PlanRecedingTask),
    timeout_s=600.0,
    memory_mb=4096,
    lane="long",
    sandbox=FILMING,
)
