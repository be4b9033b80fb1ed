"""The worst moment of every check of a certificate: as marks on the timeline, and as a list to choose from."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from stridelab.schemas.jobs import JobResult
from stridelab.schemas.plans import CertificateCheck, PlanMotionSummary
from stridelab_web.charts.intervals import Bar, Row
from stridelab_web.formatting import check_name, code_words, count_text, with_unit

MARK_PERCENT: Final = 0.5
"""Width of a mark, in percent of the motion."""


@dataclass(frozen=True)
class Moment:
    """The time at which a check is worst; ``text`` has its value and place."""

    time_s: float
    text: str
    passed: bool


def moments_of(result: JobResult) -> list[Moment]:
    """Worst moments of all checks that have a time: failed checks first, then in the order of the certificate."""
    if result.kind != "plan-motion":
        return []
    certificate = PlanMotionSummary.model_validate(result.summary).certificate
    checks = certificate.checks if certificate is not None else []
    moments = [Moment(check.time_s, _moment_text(check), check.passed) for check in checks if check.time_s is not None]
    return sorted(moments, key=lambda moment: moment.passed)


def check_rows(moments: Sequence[Moment], duration_s: float) -> list[Row]:
    """One row of marks, failed checks last and on top; empty without moments."""
    if not moments or duration_s <= 0.0:
        return []
    bars = tuple(
        Bar(
            round(min(max(100 * moment.time_s / duration_s - MARK_PERCENT / 2, 0.0), 100.0 - MARK_PERCENT), 3),
            MARK_PERCENT,
            moment.text,
            "good" if moment.passed else "bad",
            moment.time_s,
        )
        for moment in reversed(moments)
    )
    failed = sum(not moment.passed for moment in moments)
    text = f"Worst moments of {count_text(len(moments), 'check')}, {failed} of them failed"
    return [Row("Checks", bars, text, "check")]


def _moment_text(check: CertificateCheck) -> str:
    where = f", {code_words(check.effector)}" if check.effector else ""
    verdict = "" if check.passed else "failed: "
    return f"{verdict}{check_name(check.name)} {with_unit(check.value, check.unit)}{where}, {check.time_s:.2f} s"
