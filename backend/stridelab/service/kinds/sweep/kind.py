"""The job kind ``sweep``."""

from stridelab.schemas.sweeps import SweepInput, SweepSummary, SweepTask
from stridelab.service.kinds.base import JobKind
from stridelab.service.kinds.staging import stage_scenario
from stridelab.service.samples.scenarios import EXAMPLE_ID

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
    stage=stage_scenario(SweepTask),
    timeout_s=7200.0,
    memory_mb=8192,
    lane="long",
    spans_nodes=True,
)
