"""The job kind ``push-basin``."""

from stridelab.schemas.receding import PushBasinInput, PushBasinSummary, PushBasinTask
from stridelab.service.kinds.base import JobKind
from stridelab.service.kinds.staging import stage_scenario
from stridelab.service.samples.scenarios import EXAMPLE_ID

KIND = JobKind(
    name="push-basin",
    title="Pushes",
    description="Replays the motion of a scenario in a physics simulation with one push at a time, at random times and "
    "in random directions, and counts how many the robot survives; in parallel over the cores.",
    examples={
        "weak": {
            "summary": "24 pushes that change the velocity by 0.2 m/s",
            "value": {"scenario_id": EXAMPLE_ID, "speed_m_s": 0.2, "n": 24, "seed": 1},
        },
    },
    input_model=PushBasinInput,
    summary_model=PushBasinSummary,
    stage=stage_scenario(PushBasinTask),
    timeout_s=7200.0,
    memory_mb=8192,
    lane="long",
    spans_nodes=True,
)
