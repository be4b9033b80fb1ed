"""Whether the result of a job that succeeded can be used: part of every job, so that lists show it too."""

from typing import Literal

from pydantic import Field

from stridelab.schemas.base import Contract

VerdictCode = Literal[
    "certified",
    "not-certified",
    "replay-fell",
    "replay-not-completed",
    "replan-failed",
    "every-replan-solved",
    "sensors-agree",
    "sensors-doubtful",
    "sensors-contradict",
]


class JobVerdict(Contract):
    """The verdict on a result; its `outcome` is that of the worst check."""

    outcome: Literal["passed", "doubtful", "failed"]
    code: VerdictCode = Field(description="the worst that was found")
    message: str = Field(description="the verdict in words, without a full stop")
    failed_checks: list[str] = Field(
        default_factory=list, description="names of the checks of the certificate, or of the quality, that did not pass"
    )
