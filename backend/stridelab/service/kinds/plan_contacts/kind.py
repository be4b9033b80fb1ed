"""The job kind ``plan-contacts``."""

from stridelab.schemas.plans import PlanContactsInput, PlanContactsSummary
from stridelab.service.kinds.base import JobKind
from stridelab.service.kinds.staging import stage_input
from stridelab.service.samples.scenario_bodies import ONE_STEP, STANDING, STANDING_AHEAD

KIND = JobKind(
    name="plan-contacts",
    title="Contact plan",
    description="Plans contacts from a stance to a goal stance over a terrain; the scenario in the summary passes "
    "`POST /scenarios/check`. With `certify`, the motion of the plan is computed and certified, and a step at which "
    "the certificate fails is avoided in the next plan.",
    examples={
        "walk": {
            "summary": "Half a metre forward on a flat floor",
            "value": {"robot": "talos", "terrain": ONE_STEP["terrain"], "start": STANDING, "goal": STANDING_AHEAD},
        },
    },
    input_model=PlanContactsInput,
    summary_model=PlanContactsSummary,
    stage=stage_input,
    timeout_s=900.0,
    memory_mb=4096,
)
