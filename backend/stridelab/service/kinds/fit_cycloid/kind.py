"""The job kind ``fit-cycloid``."""

from stridelab.schemas.cycloid import FitCycloidInput, FitCycloidSummary
from stridelab.service.kinds.base import JobKind
from stridelab.service.kinds.staging import stage_fit_cycloid
from stridelab.service.samples.recording import SAMPLE_ID

KIND = JobKind(
    name="fit-cycloid",
    title="Rolling wheel",
    description="Fits the rolling wheel to every step of a recording, with its goodness of fit and alternative curves.",
    examples={
        "default": {"summary": "Rolling wheel of every measured step", "value": {"recording_id": SAMPLE_ID}},
        "all": {
            "summary": "Also steps off the plates, from the markers",
            "value": {"recording_id": SAMPLE_ID, "steps": "all"},
        },
    },
    input_model=FitCycloidInput,
    summary_model=FitCycloidSummary,
    stage=stage_fit_cycloid,
    timeout_s=120.0,
)
