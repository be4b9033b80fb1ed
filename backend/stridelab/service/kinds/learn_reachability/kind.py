"""The job kind ``learn-reachability``."""

from stridelab.schemas.robots import LearnReachabilityInput, LearnReachabilitySummary
from stridelab.service.kinds.base import JobKind
from stridelab.service.kinds.staging import stage_input

KIND = JobKind(
    name="learn-reachability",
    title="Reachability",
    description="Learns where the centre of mass of a robot can be relative to each of its effectors, from sampled "
    "postures.",
    examples={
        "feet": {
            "summary": "Both feet, from few samples",
            "value": {"robot": "talos", "effectors": ["left_foot", "right_foot"], "samples": 2000, "seed": 1},
        },
    },
    input_model=LearnReachabilityInput,
    summary_model=LearnReachabilitySummary,
    stage=stage_input,
    timeout_s=900.0,
    memory_mb=2048,
    lane="long",
    spans_nodes=True,
)
