"""Verdict on the result of a succeeded job; part of every job, so that lists can show it."""

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
    """Verdict on a result; `outcome` is that of the worst check."""

    outcome: Literal["passed", "doubtful", "failed"]
    code: VerdictCode = Field(description="code of the worst outcome")
    message: str = Field(description="explanation of the verdict, without a full stop")
    failed_checks: list[str] = Field(
        default_factory=list, description="names of the failed checks of the certificate or of the quality"
    )
