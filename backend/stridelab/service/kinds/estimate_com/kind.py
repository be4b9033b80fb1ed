"""The job kind ``estimate-com``."""

from stridelab.schemas.jobs import EstimateComInput, EstimateComSummary
from stridelab.service.kinds.base import JobKind
from stridelab.service.kinds.staging import stage_estimate_com
from stridelab.service.samples.recording import SAMPLE_ID

KIND = JobKind(
    name="estimate-com",
    title="Centre of mass",
    description="Estimates the centre of mass of a recording, and how well the measured forces agree with it.",
    examples={
        "default": {
            "summary": "Best estimator, everything automatic",
            "value": {"recording_id": SAMPLE_ID},
        },
        "smoother": {
            "summary": "Smoother for plates with a force error of 5 N, with the momentum of the body segments",
            "value": {
                "recording_id": SAMPLE_ID,
                "method": "smoother",
                "smoother": {"priors": {"plate_force_n": 5.0}, "segment_momentum": True},
            },
        },
        "filter": {
            "summary": "Complementary filter with custom cut-off frequencies, latency compensated",
            "value": {
                "recording_id": SAMPLE_ID,
                "method": "complementary",
                "latency": "apply",
                "segment_table": "dumas2007",
                "cutoffs": [0.5, 3.0],
            },
        },
    },
    input_model=EstimateComInput,
    summary_model=EstimateComSummary,
    stage=stage_estimate_com,
    timeout_s=120.0,
)
