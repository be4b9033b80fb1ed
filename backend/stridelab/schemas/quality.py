"""Whether the sensors of a recording agree: part of every result of a recording."""

from typing import Literal

from pydantic import Field

from stridelab.schemas.base import Contract

Verdict = Literal["good", "doubtful", "contradicted"]


class QualityCheck(Contract):
    """One number against its limit, and the sentence that names the sensors it holds together."""

    name: str
    value: float
    unit: str = Field(description='"m", or "1" for a ratio')
    limit: float = Field(description="the largest value that passes")
    contradicted_above: float = Field(description="above this the sensors cannot both be right")
    passed: bool
    message: str


class Quality(Contract):
    """The verdict: `good` where every check passes, `contradicted` where one of them cannot be."""

    verdict: Verdict
    checks: list[QualityCheck]
    not_checked: dict[str, str] = Field(description="checks that were not possible, and why")


class TrialQuality(Contract):
    """The quality of one recording among several."""

    recording_id: str
    filename: str
    quality: Quality
