"""Consistency of the sensors of a recording; part of every result of a recording."""

from typing import Literal

from pydantic import Field

from stridelab.schemas.base import Contract

Verdict = Literal["good", "doubtful", "contradicted"]


class QualityCheck(Contract):
    """One consistency check: a value, its limit, and a message that names the sensors compared."""

    name: str
    value: float
    unit: str = Field(description='"m", or "1" for a ratio')
    limit: float = Field(description="maximum value that passes")
    contradicted_above: float = Field(description="above this value, the sensors contradict each other")
    passed: bool
    message: str


class Quality(Contract):
    """Verdict: `good` if every check passes, `contradicted` if the sensors contradict each other in one of them."""

    verdict: Verdict
    checks: list[QualityCheck]
    not_checked: dict[str, str] = Field(description="checks that were not possible, with the reason")


class TrialQuality(Contract):
    """Quality of one of several recordings."""

    recording_id: str
    filename: str
    quality: Quality
