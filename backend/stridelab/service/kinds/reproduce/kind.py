"""The job kind ``reproduce``."""

from stridelab.schemas.reproduction import ReproduceInput, ReproduceSummary
from stridelab.service.kinds.base import JobKind
from stridelab.service.kinds.staging import stage_input

KIND = JobKind(
    name="reproduce",
    title="Reproduction",
    description="Computes a figure or table of the thesis: its values and those of this program, with a verdict per "
    "claim.",
    examples={
        "bode": {"summary": "Gains of the three filters", "value": {"item": "fig-2.5"}},
        "comparison": {
            "summary": "Complementary filter against Kalman filter, with ten noise realisations",
            "value": {"item": "fig-2.7", "seeds": 10, "seed": 100},
        },
    },
    input_model=ReproduceInput,
    summary_model=ReproduceSummary,
    stage=stage_input,
    timeout_s=3600.0,
    memory_mb=4096,
    lane="long",
)
